// What threads tell a report, where a device has no subgroups: each speaks for itself.

fn least_of(x: u32) -> u32 {
    return x;
}

fn greatest_of(x: u32) -> u32 {
    return x;
}

fn count_of(is: bool) -> u32 {
    return select(0u, 1u, is);
}

fn speaks() -> bool {
    return true;
}
