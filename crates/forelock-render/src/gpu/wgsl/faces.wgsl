// Triangles of bodies.

@group(0) @binding(21) var<storage, read> vertices: array<Vertex>;
// The numbers of the vertices, three a triangle.
@group(0) @binding(22) var<storage, read> faces: array<u32>;

// Corner `i` of a triangle.
fn corner_of(face: u32, i: u32) -> Vertex {
    return vertices[faces[3u * face + i]];
}

// The place of corner `i`, world space.
fn place_of(face: u32, i: u32) -> vec3f {
    return vertices[faces[3u * face + i]].position;
}
