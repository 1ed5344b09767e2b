"""The paper's tables and figures from configuration alone: parts that run once, and the document made of them."""
