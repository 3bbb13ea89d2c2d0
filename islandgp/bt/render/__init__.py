"""Pictures of trees: in a terminal, as SVG, as Mermaid and as Graphviz dot."""
