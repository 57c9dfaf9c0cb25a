"""Texture space: which texels a surface covers, what lies under each, and how the rest of the picture is filled."""
