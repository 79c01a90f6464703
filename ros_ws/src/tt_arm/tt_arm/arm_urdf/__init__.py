"""Read an arm from its URDF: the chain of joints, the meshes, and the bodies that must not touch anything."""
