// Reductions for devices with subgroups: of the active threads only those with the smallest or the
// greatest value write.

fn is_least(x: u32) -> bool {
    return x == subgroupMin(x);
}

fn is_greatest(x: u32) -> bool {
    return x == subgroupMax(x);
}
