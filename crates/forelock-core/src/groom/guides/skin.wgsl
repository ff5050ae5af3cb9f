// Skinning of all strands by guides: the GPU counterpart of `guides::follow` and `guides::carried`.
// All positions are relative to the middle of the guides' rest shape and to the frame's origin.

struct Skin {
    // Rotation of the head, a quaternion.
    head: vec4f,
    // Number of skinned particles.
    count: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

// Rotation and translation of each particle of the guides, two entries each.
@group(0) @binding(21) var<storage, read_write> motions: array<vec4f>;
@group(0) @binding(22) var<uniform> skin: Skin;

fn rotated(q: vec4f, v: vec3f) -> vec3f {
    let t = 2.0 * cross(q.xyz, v);
    return v + q.w * t + cross(q.xyz, t);
}
