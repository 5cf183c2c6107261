"""Physics: N robots, one policy step at a time, and the named quantities of every tick."""
