"""Pictures of a comparison: figure data as plain values, and what draws them."""
