"""Damaged files of every format that surefoot reads, made from a seed, and the functions that read them."""
