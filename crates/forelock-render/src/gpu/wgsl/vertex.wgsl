// Of a body, world space.
struct Vertex {
    position: vec3f,
    // 1 if it has a face.
    has_face: f32,
    normal: vec3f,
    brow_red: f32,
    skin: vec3f,
    brow_green: f32,
    rest: vec3f,
    brow_blue: f32,
}

