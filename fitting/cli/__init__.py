"""The commands of ``fmu-fit``, a module each: NAME, EXAMPLE, add_arguments, run."""
