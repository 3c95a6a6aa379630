"""What runs inside Blender; alone here, as Blender looks for add-ons beside its script."""
