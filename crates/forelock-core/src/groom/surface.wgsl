// Roots on a surface that bends: their number and their motions at two poses.

struct Surface {
    // Triangles, corners of the roots' triangles, and roots.
    triangles: u32,
    corners: u32,
    roots: u32,
    // The first entry of `root_frames` that is written, and those that are packed as the frames at
    // the start and at the end.
    frames: u32,
    start: u32,
    end: u32,
    pad_0: u32,
    pad_1: u32,
}

@group(0) @binding(42) var<uniform> surface: Surface;
// The rotation and the shift of each root, at two poses.
@group(0) @binding(50) var<storage, read_write> root_frames: array<vec4f>;
