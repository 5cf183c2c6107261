"""Task: the observations, actions and rewards of a policy, and the pushes of the robots."""
