"""Robots: one MJCF file each, with its poses and pushable bodies in the module of the same name."""
