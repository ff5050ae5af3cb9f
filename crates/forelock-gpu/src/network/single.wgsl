// Weights and sums of strands in float32.
alias Packed = vec4f;

fn unpacked(x: Packed) -> vec4f {
    return x;
}
