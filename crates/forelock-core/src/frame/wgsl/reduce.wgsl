// What threads tell a report, where a device has no subgroups: each speaks for itself.

fn is_least(x: u32) -> bool {
    return true;
}

fn is_greatest(x: u32) -> bool {
    return true;
}
