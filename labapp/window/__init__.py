"""The lab application's window, and the engine process that works for it.

The window's process only shows things and takes input: it never computes, never waits for a device,
and never imports torch, h5py or the bench. The engine's process (labapp.window.engine) does all of
that. It is sent commands (labapp.window.commands) and sends messages (labapp.window.messages).
"""
