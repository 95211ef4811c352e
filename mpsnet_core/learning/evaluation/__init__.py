"""Evaluation of models: data sets with known normals, tables and reports."""
