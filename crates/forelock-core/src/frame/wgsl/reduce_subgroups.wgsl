// What threads tell a report, where a device has subgroups: of those that come along only who has the least or the greatest.

fn is_least(x: u32) -> bool {
    return x == subgroupMin(x);
}

fn is_greatest(x: u32) -> bool {
    return x == subgroupMax(x);
}
