"""Where in the box the lowest minima are: points spread over it, descents from the best of them."""
