"""The compiled equations of motion of one vessel: text, compilation, and the loops around them."""
