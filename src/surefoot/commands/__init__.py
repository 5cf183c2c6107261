"""The commands of `surefoot`, a dataclass each: its fields are the options, their docstrings the help."""
