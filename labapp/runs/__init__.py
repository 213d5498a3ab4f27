"""Plan, take, record, resume, verify, show and export runs."""
