// Guides carry all strands: the twin of `guides::follow` and `guides::carried`. Everything is relative to the middle of the guides' rest shape, and to where the frame's origin is.

struct Skin {
    // The head's rotation, as a quaternion.
    head: vec4f,
    // Particles that are carried.
    count: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

// Rotation and shift of each of the guides' particles, a pair an entry.
@group(0) @binding(21) var<storage, read_write> motions: array<vec4f>;
@group(0) @binding(22) var<uniform> skin: Skin;

fn rotated(q: vec4f, v: vec3f) -> vec3f {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}
