"""Robots: an arm's recording checked, its joints' friction identified, and what each joint's model lacks named."""
