"""From a problem and values of a parameter to modes, branches and onsets, and what is proven of them."""
