//! Damage: one to four changes of a whole file.

/// Numbers that break counts, sizes and offsets.
const NUMBERS: [u64; 18] = [
    0,
    1,
    2,
    3,
    0x7f,
    0xff,
    0x7fff,
    0xffff,
    0x0001_0000,
    0x00ff_ffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x0001_0000_0000,
    0x4000_0000_0000_0000,
    0x7fff_ffff_ffff_ffff,
    0x8000_0000_0000_0000,
    u64::MAX,
];
/// The same in text.
const WORDS: [&str; 14] = [
    "0",
    "-1",
    "1",
    "2",
    "65536",
    "1048576",
    "2147483648",
    "4294967295",
    "99999999999999999999",
    "1e38",
    "1e999",
    "nan",
    "inf",
    "0.5",
];

/// The most bytes that are added at once.
const LONGEST: usize = 100_000;

/// Numbers from a seed, after Steele et al. 2014, 'Fast Splittable Pseudorandom Number Generators'.
pub struct Random(u64);

impl Random {
    /// Those of execution `number` of a reader.
    pub fn new(reader: &str, seed: u64, number: u64) -> Self {
        let name = reader.bytes().fold(seed, |sum, byte| sum.wrapping_mul(257).wrapping_add(byte.into()));
        let mut own = Self(name);
        own.0 = own.next() ^ number;
        own.next();
        own
    }

    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `most`, or 0 if that is 0.
    pub fn below(&mut self, most: usize) -> usize {
        (self.next() % (most as u64).max(1)) as usize
    }

    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.below(list.len())]
    }
}

/// One of `seeds`, damaged. There must be one.
pub fn damaged(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut bytes = seeds[random.below(seeds.len())].clone();
    for _ in 0..=random.below(4) {
        change(&mut bytes, seeds, random);
    }
    bytes
}

/// A place in `bytes`: anywhere, or often in the first or last bytes, where headers and tables are.
fn place(bytes: &[u8], random: &mut Random) -> usize {
    let near = bytes.len().min(512);
    match random.below(4) {
        0 => random.below(near),
        1 => bytes.len() - random.below(near).min(bytes.len()) - usize::from(!bytes.is_empty()),
        _ => random.below(bytes.len()),
    }
}

fn change(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], random: &mut Random) {
    let at = place(bytes, random);
    let most = 1 << random.below(9);
    let span = 1 + random.below(most);
    let end = bytes.len().min(at + span);
    match random.below(11) {
        0 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        1 if at < bytes.len() => bytes[at] = random.of(&[0, 1, 0x7f, 0x80, 0xff, b'0', b'9', b'-', b' ']),
        2 => bytes.truncate(at),
        3 => drop(bytes.drain(at..end)),
        // A span comes twice, or replaces another one.
        4 => {
            let copied = bytes[at..end].to_vec();
            let to = place(bytes, random).min(bytes.len());
            insert(bytes, to, &copied);
        }
        5 => {
            let to = random.below((bytes.len() + 1).saturating_sub(end - at));
            bytes.copy_within(at..end, to);
        }
        // The end of another file.
        6 => {
            let other = &seeds[random.below(seeds.len())];
            bytes.truncate(at);
            bytes.extend(&other[random.below(other.len())..]);
        }
        7 => replace_word(bytes, at, random),
        // A span comes again and again: lists grow, and what nests, nests deeply.
        8 => {
            let span = bytes[at..end].to_vec();
            // Long ones are slow to read, so they are rare.
            let longest = if random.below(8) == 0 { 15 } else { 7 };
            let most = 1 << random.below(longest);
            let times = random.below(most).min(LONGEST / span.len().max(1));
            insert(bytes, at, &span.repeat(times));
        }
        _ => replace_number(bytes, at, random),
    }
}

/// Puts `new` before byte `at`: for long spans faster than `Vec::splice`.
fn insert(bytes: &mut Vec<u8>, at: usize, new: &[u8]) {
    let end = bytes.len();
    bytes.resize(end + new.len(), 0);
    bytes.copy_within(at..end, at + new.len());
    bytes[at..at + new.len()].copy_from_slice(new);
}

/// Overwrites a number of 1, 2, 4 or 8 bytes, mostly where a number may be.
fn replace_number(bytes: &mut [u8], at: usize, random: &mut Random) {
    let width = random.of(&[1, 2, 4, 4, 4, 8, 8]);
    let at = if random.below(4) == 0 { at } else { at / 4 * 4 };
    let length = bytes.len() as u64;
    let Some(own) = bytes.get_mut(at..at + width) else { return };
    let mut old = [0; 8];
    old[..width].copy_from_slice(own);
    let old = u64::from_le_bytes(old);
    let new = match random.below(6) {
        0 => old.wrapping_add(1),
        1 => old.wrapping_sub(1),
        2 => old.wrapping_mul(1 << random.below(32)),
        3 => length.wrapping_add(random.below(9) as u64).wrapping_sub(4),
        _ => random.of(&NUMBERS),
    };
    own.copy_from_slice(&new.to_le_bytes()[..width]);
    if random.below(8) == 0 {
        own.reverse();
    }
}

/// Replaces the number in text that is next to `at`.
fn replace_word(bytes: &mut Vec<u8>, at: usize, random: &mut Random) {
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let Some(start) = bytes.iter().skip(at).position(is_digit).map(|skip| at + skip) else { return };
    let length = bytes[start..].iter().take_while(|byte| is_digit(byte)).count();
    bytes.splice(start..start + length, random.of(&WORDS).bytes());
}
