"""What people read of a result: its words, figures and one self-contained page."""
