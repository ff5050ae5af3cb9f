//! Lists that are filled anew each frame and keep their memory.

/// `list` with `len` entries: those that it held before, and then `value`. Where it must grow it takes room for twice as many, so that what grows a little
/// from frame to frame seldom allocates and leaves no holes behind; room that is not used costs addresses, not memory.
pub(crate) fn resize<V: Copy>(list: &mut Vec<V>, len: usize, value: V) {
    if list.capacity() < len {
        list.reserve_exact(2 * len - list.len());
    }
    list.resize(len, value);
}

/// `list` with `len` times `value` and nothing else; grows as [`resize`] does.
pub(crate) fn fill<V: Copy>(list: &mut Vec<V>, len: usize, value: V) {
    list.clear();
    resize(list, len, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_that_has_grown_has_room_for_twice_as_many() {
        let mut list = vec![1u32; 3];
        resize(&mut list, 100, 2);
        assert_eq!((&list[..4], list.len()), (&[1, 1, 1, 2][..], 100));
        let room = list.capacity();
        fill(&mut list, 200, 3);
        assert!(list.iter().all(|&x| x == 3) && list.len() == 200);
        assert_eq!(list.capacity(), room);
    }
}
