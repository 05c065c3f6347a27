"""The experiments of Saldarriaga-Mesa et al., Robotics 2025, 14(9), 124, run again."""
