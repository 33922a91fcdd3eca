"""The worker processes: one FMU each, held open, and what caller and worker exchange."""
