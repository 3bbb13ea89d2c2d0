"""Figures 4 to 10, and those beyond the paper; each as SVG and PNG."""
