//! The names of attributes that grooms are read from and written to.

/// Linear RGB.
pub(super) const COLOUR: &str = "primvars:displayColor";
/// 1 minus the transparency.
pub(super) const OPACITY: &str = "primvars:displayOpacity";
/// Texture coordinates of the roots. The first is written, and the first that is there is read.
pub(super) const ROOT_UVS: [&str; 6] = [
    "primvars:st",
    "primvars:groom_root_uv",
    "primvars:root_uv",
    "primvars:uv",
    "primvars:surface_uv_coordinate",
    "primvars:UVMap",
];
/// Particles that are fixed at the root.
pub(super) const PINNED: &str = "primvars:forelock_pinned";
/// Factors on the stiffness.
pub(super) const STIFFNESS: &str = "primvars:forelock_stiffness";
/// Triangle, barycentric coordinates and distance of the root bindings.
pub(super) const BINDING: [&str; 3] = [
    "primvars:forelock_root_triangle",
    "primvars:forelock_root_barycentric",
    "primvars:forelock_root_distance",
];
