"""Works that are killed, what they have told until then, and what is found afterwards of what they did."""
