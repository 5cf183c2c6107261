"""Rendering: pictures and films of trials, drawn offscreen."""
