// Weights and sums of strands in float16, two a number.
alias Packed = vec2u;

fn unpacked(x: Packed) -> vec4f {
    return vec4f(unpack2x16float(x.x), unpack2x16float(x.y));
}
