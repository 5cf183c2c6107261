"""surefoot: learn, test and ship push-recovery policies for humanoid robots."""

__version__ = "0.1.0"
