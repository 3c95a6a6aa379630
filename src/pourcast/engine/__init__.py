"""The particle engine: arrays in, arrays out.

Nothing in this folder knows a scene, a file or the command line. The chapters
are the field's own: `kernel` (smoothing kernel), `packing` (particle start),
`sph` (density, pressure, artificial viscosity), `neighbours` (neighbour list),
`rigid` (inelastic spheres), `contact` (spheres against polygons and the box),
`batch` (many simulations at once). `simd` and `compile` hold the vector type
and the compiler options that all of them share.
"""
