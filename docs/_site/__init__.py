"""What the site has beyond its Markdown files: pages written from the code, the navigation, and equations as MathML."""
