// What all stages know of the picture, and the curves that it shows.

struct Frame {
    eye: vec3f,
    // Pixels per unit of x / z.
    focal: f32,
    right: vec3f,
    // Depth of the near plane, metres.
    near: f32,
    up: vec3f,
    exposure: f32,
    forward: vec3f,
    // Drawn particles.
    points: u32,
    // Ambient light from above and from below.
    sky: vec3f,
    lights: u32,
    ground: vec3f,
    // Room in the list of pieces.
    capacity: u32,
    shadow_origin: vec3f,
    shadow_cell: f32,
    shadow_size: vec3u,
    unused: u32,
    open_origin: vec3f,
    // 0 without a grid.
    open_cell: f32,
    open_size: vec3u,
    // The first value of the grid in `grids`.
    open_start: u32,
    // Colours behind everything, and how much darker its corners are.
    backdrop_top: vec3f,
    vignette: f32,
    backdrop_bottom: vec3f,
    // Points of an edge at which light is computed.
    lit_each: u32,
    // Of the picture, pixels.
    centre: vec2f,
    size: vec2u,
    tiles: vec2u,
    // Triangles of bodies.
    faces: u32,
    // Strands that the grids are made of.
    samples: u32,
    // Directions in which grids are swept.
    sweeps: u32,
    // Threads that draw a triangle into the shadow maps.
    slices: u32,
    // Of bodies.
    vertices: u32,
    // Depth of the near plane of the target that is drawn over, metres; 0 without one.
    target_near: f32,
}

// A strand or one of its children.
struct Curve {
    // The number of its first coordinate in `positions`.
    base: u32,
    // Its first particle in the arrays of attributes.
    first: u32,
    // Its particles.
    count: u32,
    // Its first point.
    start: u32,
    // The offset of a child, metres.
    offset: vec3f,
    wave: f32,
    log_albedo: vec3f,
    tilt: f32,
    // How much brighter and greyer than the others it is.
    bright: f32,
    grey: f32,
    has_colours: u32,
    // The factor on its width.
    detail: f32,
}

// The number of an invocation of a dispatch in two dimensions.
fn thread_of(group: vec3u, groups: vec3u, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * THREADS + local;
}
