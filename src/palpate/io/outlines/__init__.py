"""Outlines of objects in files: tables of points, JSON, SVG and DXF drawings, and scans."""
