"""The commands of ``fmu-fit``, a module each: NAME, SUMMARY, EXAMPLE, add_arguments, run."""
