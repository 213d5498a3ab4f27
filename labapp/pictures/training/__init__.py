"""Train the denoising network for plug-and-play restoration from pictures."""
