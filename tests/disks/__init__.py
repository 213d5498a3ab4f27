"""What a disk holds after a power cut or a failed sync, by the calls that a command made."""
