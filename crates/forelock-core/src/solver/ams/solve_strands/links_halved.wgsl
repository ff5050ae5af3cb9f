// Storage of the factors L in scratch, in 16 bits, two numbers in a row. This halves the memory
// traffic of `links.wgsl`.

// Stores column c of the three factors of row i.
fn store_links(strand: Strand, i: u32, c: u32, l1: vec3f, l2: vec3f, l3: vec3f) {
    let at = entry(strand, i, SCRATCH, 5u * c);
    scratch[at] = pack2x16float(l1.xy);
    scratch[at + LANES] = pack2x16float(vec2f(l1.z, l2.x));
    scratch[at + 2u * LANES] = pack2x16float(l2.yz);
    scratch[at + 3u * LANES] = pack2x16float(l3.xy);
    scratch[at + 4u * LANES] = pack2x16float(vec2f(l3.z, 0.0));
}

// Component c of Σ_k L_{i+k,i}ᵀ v_k.
fn linked(strand: Strand, i: u32, c: u32, v1: vec3f, v2: vec3f, v3: vec3f) -> f32 {
    let at = entry(strand, i, SCRATCH, 5u * c);
    let l1 = unpack2x16float(scratch[at]);
    let l12 = unpack2x16float(scratch[at + LANES]);
    let l2 = unpack2x16float(scratch[at + 2u * LANES]);
    let l3 = unpack2x16float(scratch[at + 3u * LANES]);
    let last = unpack2x16float(scratch[at + 4u * LANES]).x;
    return dot(vec3f(l1, l12.x), v1) + dot(vec3f(l12.y, l2), v2) + dot(vec3f(l3, last), v3);
}
