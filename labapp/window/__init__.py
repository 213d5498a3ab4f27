"""The window: what a person at the bench sees, and the engine process that does the work.

The window's process never computes and never waits, and never imports torch, h5py or the
bench; the engine's process (labapp.window.engine) does all of that. They talk in the
messages of labapp.window.messages.
"""
