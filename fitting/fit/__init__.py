"""The inverse problem: objective, Algorithm 2, the fit."""
