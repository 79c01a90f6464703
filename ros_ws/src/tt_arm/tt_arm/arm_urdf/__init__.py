"""An arm as its URDF describes it: the chain of joints, meshes, and the bodies that must not touch anything."""
