// Reductions for devices without subgroups: every thread writes.

fn is_least(x: u32) -> bool {
    return true;
}

fn is_greatest(x: u32) -> bool {
    return true;
}
