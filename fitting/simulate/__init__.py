"""What is asked of an FMU, and how accurately: one plan, drives, sweeps, batches of runs."""
