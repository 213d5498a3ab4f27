"""What each study is and what can be set: read without loading what carries it out."""
