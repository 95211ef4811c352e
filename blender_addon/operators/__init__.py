"""What the operators share: bad input becomes one sentence, and the core runs beside a live window."""
