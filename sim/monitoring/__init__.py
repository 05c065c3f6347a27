"""Is the model of a boat under way still right, and does a current or a wind explain where not?"""
