// Storage of the factors L in scratch, in 32 bits.

// Stores column c of the three factors of row i.
fn store_links(strand: Strand, i: u32, c: u32, l1: vec3f, l2: vec3f, l3: vec3f) {
    set_scratch_vector(strand, i, 3u * c, l1);
    set_scratch_vector(strand, i, 9u + 3u * c, l2);
    set_scratch_vector(strand, i, 18u + 3u * c, l3);
}

// Component c of Σ_k L_{i+k,i}ᵀ v_k.
fn linked(strand: Strand, i: u32, c: u32, v1: vec3f, v2: vec3f, v3: vec3f) -> f32 {
    let near = dot(scratch_vector(strand, i, 3u * c), v1) + dot(scratch_vector(strand, i, 9u + 3u * c), v2);
    return near + dot(scratch_vector(strand, i, 18u + 3u * c), v3);
}
