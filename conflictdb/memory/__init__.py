"""Without a database: `solve`, delays, speeds, chances and `Index`; clear a scene, with proof."""
