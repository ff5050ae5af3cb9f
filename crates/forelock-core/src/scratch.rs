//! Helpers for vectors that are refilled every frame and keep their allocation.

/// Resizes `list` to `len` entries: existing entries are kept, new ones are `value`. If the vector
/// must grow, it reserves twice the needed capacity, so that a list that grows a little every frame
/// rarely reallocates. The unused capacity costs address space, not physical memory.
pub(crate) fn resize<V: Copy>(list: &mut Vec<V>, len: usize, value: V) {
    if list.capacity() < len {
        list.reserve_exact(2 * len - list.len());
    }
    list.resize(len, value);
}

/// Replaces the content of `list` by `len` copies of `value`; grows as [`resize`] does.
pub(crate) fn fill<V: Copy>(list: &mut Vec<V>, len: usize, value: V) {
    list.clear();
    resize(list, len, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growing_reserves_twice_the_needed_capacity() {
        let mut list = vec![1u32; 3];
        resize(&mut list, 100, 2);
        assert_eq!((&list[..4], list.len()), (&[1, 1, 1, 2][..], 100));
        let room = list.capacity();
        fill(&mut list, 200, 3);
        assert!(list.iter().all(|&x| x == 3) && list.len() == 200);
        assert_eq!(list.capacity(), room);
    }
}
