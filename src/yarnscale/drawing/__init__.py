"""What makes patterns: curves, charts of knits and weaves, built-in patterns, the size of a stitch."""
