"""The robot drawn in 3D: what is known (`scene`), as simple shapes (`items`), shown in a browser or published as markers."""
