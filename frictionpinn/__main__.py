"""``python -m frictionpinn COMMAND ...``."""

from frictionpinn.workflow.commands import main

main()
