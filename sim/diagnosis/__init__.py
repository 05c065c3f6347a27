"""Which physical effect a model lacks: from trials and a vessel to an answer (`diagnose`)."""
