"""The particle engine: arrays in, arrays out.

Nothing in this folder knows a scene, a file or the command line. The chapters
are the field's own: `smoothing` (kernel W), `packing` (particle start),
`density`, `equation_of_state`, `viscosity`, `walls`, `momentum`, `integrator`
and `sph`, which composes them; `clusters` (one simulation by near pairs), `rigid`
(inelastic spheres), `polygons`, `solids` and `contact` (spheres against polygons
and the box), `diagnostics` (energy, and whether a simulation can be trusted), `batch`
(many simulations at once). `state`, `simd` and `compile` hold the arrays, the
vector type and the compiler options that all of them share.
"""
