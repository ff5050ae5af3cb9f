// Moves the vertices of bodies to world space, one thread a vertex.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(19) var<storage, read> meshes: array<MeshVertex>;
@group(0) @binding(20) var<storage, read> placements: array<Placement>;
@group(0) @binding(21) var<storage, read_write> vertices: array<Vertex>;

// A vertex in mesh space.
struct MeshVertex {
    position: vec3f,
    // The share of the hair's colour.
    share: f32,
    normal: vec3f,
    body: u32,
    // Its place on the built-in head.
    rest: vec3f,
    unused: u32,
}

// Where a body is, and its colours.
struct Placement {
    x_axis: vec3f,
    // 1 if it has a face.
    has_face: f32,
    y_axis: vec3f,
    unused_y: u32,
    z_axis: vec3f,
    unused_z: u32,
    origin: vec3f,
    unused_origin: u32,
    skin: vec3f,
    unused_skin: u32,
    scalp: vec3f,
    unused_scalp: u32,
    brows: vec3f,
    unused_brows: u32,
}

fn turned(own: Placement, v: vec3f) -> vec3f {
    return own.x_axis * v.x + own.y_axis * v.y + own.z_axis * v.z;
}

@compute @workgroup_size(THREADS)
fn place(
    @builtin(workgroup_id) group: vec3u,
    @builtin(num_workgroups) groups: vec3u,
    @builtin(local_invocation_index) local: u32,
) {
    let at = thread_of(group, groups, local);
    if at >= frame.vertices {
        return;
    }
    let mesh = meshes[at];
    let own = placements[mesh.body];
    var vertex: Vertex;
    vertex.position = turned(own, mesh.position) + own.origin;
    vertex.has_face = own.has_face;
    vertex.normal = turned(own, mesh.normal);
    vertex.skin = mix(own.skin, own.scalp, mesh.share);
    vertex.rest = mesh.rest;
    vertex.brow_red = own.brows.x;
    vertex.brow_green = own.brows.y;
    vertex.brow_blue = own.brows.z;
    vertices[at] = vertex;
}
