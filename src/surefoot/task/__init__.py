"""The task: what a policy sees, does and earns, and who is pushed when."""
