"""The live page: robots that anyone can push by hand in a browser."""
