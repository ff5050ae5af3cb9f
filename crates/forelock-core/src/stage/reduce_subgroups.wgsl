// What threads tell a report, where a device has subgroups: one speaks for all that come along.

fn least_of(x: u32) -> u32 {
    return subgroupMin(x);
}

fn greatest_of(x: u32) -> u32 {
    return subgroupMax(x);
}

fn count_of(is: bool) -> u32 {
    return subgroupAdd(select(0u, 1u, is));
}

fn speaks() -> bool {
    return subgroupExclusiveAdd(1u) == 0u;
}
