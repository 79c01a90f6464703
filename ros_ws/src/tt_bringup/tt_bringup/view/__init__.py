"""The robot drawn in 3D: the known state (`scene`) as simple shapes (`items`), which are shown in a browser or published as markers."""
