"""Ambient occlusion: axes, near/far maps, visibility sums in texture space, and the estimate made of them."""
