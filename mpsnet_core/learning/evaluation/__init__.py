"""How good the estimates are: data sets with known normals, tables and pictures."""
