//! Types of scan elements, and where the elements are.

use super::super::element::{Element, Layout};
use super::super::format::Format;
use super::super::sysfs::Folder;
use super::tree::Fake;

#[test]
fn a_type_says_how_a_number_is_stored() {
    let cases: &[(&str, &[u8], i64)] = &[
        ("le:s8/8>>0", &[0x80], -128),
        ("be:u8/8>>0", &[0xff], 255),
        ("le:s6/8>>2", &[0b1000_0011], -32),
        ("le:s16/16>>0", &[0xfe, 0xff], -2),
        ("be:s16/16>>0", &[0x02, 0xc8], 712),
        ("be:u16/16>>0", &[0xff, 0xfe], 65534),
        ("le:s12/16>>4", &[0x0f, 0x80], -2048),
        ("be:s14/16>>2", &[0xff, 0xfb], -2),
        ("le:s24/32>>0", &[0xff, 0xff, 0xff, 0x55], -1),
        ("le:s24/32>>8", &[0x55, 0x00, 0x00, 0x80], -8_388_608),
        ("be:u24/32>>8", &[0xff, 0xff, 0xfe, 0x55], 16_777_214),
        ("be:s32/32>>0", &[0xff, 0xff, 0xfe, 0xef], -273),
        ("le:u32/32>>0", &[0xff, 0xff, 0xff, 0xff], 4_294_967_295),
        ("le:s64/64>>0", &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x7f], i64::MAX),
        ("be:s64/64>>0", &[0x80, 0, 0, 0, 0, 0, 0, 1], i64::MIN + 1),
        ("be:u63/64>>1", &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff], i64::MAX),
        ("le:s16/16", &[0x01, 0x00], 1),
    ];
    for (kind, bytes, value) in cases {
        assert_eq!(Format::parse(kind).unwrap().decode(bytes), *value, "{kind}");
    }
}

/// Every storage, width, shift, sign and order, with the other bits set and not.
#[test]
fn every_width_and_shift_gives_the_number_back() {
    let mut cases = 0;
    for storage in [8_u32, 16, 32, 64] {
        for bits in 1..=storage {
            for shift in 0..=storage - bits {
                for (sign, order) in [("s", "le"), ("u", "le"), ("s", "be"), ("u", "be")] {
                    if bits == 64 && sign == "u" {
                        continue;
                    }
                    let format = Format::parse(&format!("{order}:{sign}{bits}/{storage}>>{shift}")).unwrap();
                    check(format, (sign == "s", order == "be"), (storage, bits, shift));
                    cases += 1;
                }
            }
        }
    }
    assert_eq!(cases, 4 * (36 + 136 + 528 + 2080) - 2);
}

fn check(format: Format, (signed, big): (bool, bool), (storage, bits, shift): (u32, u32, u32)) {
    let lowest = if signed { -(1_i128 << (bits - 1)) } else { 0 };
    let highest = lowest + (1_i128 << bits) - 1;
    for number in [lowest, lowest + 1, 0, highest - 1, highest] {
        let number = number.clamp(lowest, highest);
        let mask = (1_i128 << bits) - 1;
        for others in [0, !(mask << shift)] {
            let stored = (number & mask) << shift | others;
            let bytes = stored.to_le_bytes();
            let mut bytes = bytes[..storage as usize / 8].to_vec();
            if big {
                bytes.reverse();
            }
            assert_eq!(i128::from(format.decode(&bytes)), number, "{format:?}");
        }
    }
}

#[test]
fn what_is_no_type_is_refused() {
    let refused = [
        ("", "none of"),
        ("le", "none of"),
        ("xe:s16/16>>0", "none of"),
        ("le:16/16>>0", "none of"),
        ("le:s/16>>0", "none of"),
        ("le:s16>>0", "none of"),
        ("le:s16/16>>", "none of"),
        ("le:s16/16>>-1", "none of"),
        ("le:é6/16", "none of"),
        ("le:f32/32>>0", "floating point"),
        ("le:s17/16>>0", "outside its storage"),
        ("le:s16/16>>1", "outside its storage"),
        ("le:s0/16>>0", "outside its storage"),
        ("le:s1/64>>4294967295", "outside its storage"),
        ("le:s24/24>>0", "storage of other than"),
        ("le:s128/128>>0", "storage of other than"),
        ("le:u64/64>>0", "without a sign"),
        ("le:s16/16X0>>0", "repeats"),
        ("le:s16/16X3>>0", "repeats"),
        ("le:s16/16X99999999999999999999>>0", "none of"),
        ("le:s64/64X4611686018427387904>>0", "repeats"),
    ];
    for (kind, cause) in refused {
        let fault = Format::parse(kind).unwrap_err();
        assert!(fault.contains(cause), "{kind}: {fault}");
    }
}

fn folder() -> (Fake, Folder) {
    let fake = Fake::new();
    let folder = fake.tree.folder(fake.root().to_owned(), "a device");
    (fake, folder)
}

/// Elements in the order of their indices, `name type`.
fn layout(elements: &[&str]) -> Layout {
    let (_fake, folder) = folder();
    let elements: Vec<Element> = (0..elements.len())
        .zip(elements)
        .map(|(index, text)| {
            let (name, kind) = text.split_once(' ').unwrap();
            Element { name: name.to_owned(), index: index as u32, kind: kind.to_owned() }
        })
        .rev()
        .collect();
    Layout::new(&folder, &elements).unwrap()
}

/// By hand, from `iio_compute_scan_bytes` of the kernel.
#[test]
fn each_element_is_at_a_multiple_of_its_size() {
    let cases: &[(&[&str], &[usize], usize)] = &[
        (&["a le:s16/16>>0", "b le:s16/16>>0", "c le:s16/16>>0", "timestamp le:s64/64>>0"], &[0, 2, 4, 8], 16),
        (&["a be:s32/32>>0", "b be:s16/16>>0", "timestamp le:s64/64>>0"], &[0, 4, 8], 16),
        (&["a be:s16/16>>0", "b be:s32/32>>0", "c be:s32/32>>0"], &[0, 4, 8], 12),
        (&["a le:u8/8>>0", "b le:s16/16>>0", "c le:u8/8>>0", "d le:s64/64>>0"], &[0, 2, 4, 8], 16),
        // The whole is a multiple of the largest: the next scan's first element is at a multiple of 8.
        (&["a le:s64/64>>0", "b le:u8/8>>0"], &[0, 8], 16),
        (&["a le:s32/32>>0", "b le:s16/16>>0"], &[0, 4], 8),
        (&["a le:s24/32>>8", "timestamp le:s64/64>>0"], &[0, 8], 16),
        // An element of four numbers of 32 bits is aligned as one of 16 bytes.
        (&["a le:s16/16>>0", "q le:s32/32X4>>0", "timestamp le:s64/64>>0"], &[0, 16, 32], 48),
        // The kernel puts the timestamp last whatever its index.
        (&["timestamp le:s64/64>>0", "a le:s16/16>>0"], &[8, 0], 16),
        (&["a le:s8/8>>0"], &[0], 1),
    ];
    for (elements, places, bytes) in cases {
        let layout = layout(elements);
        let names = elements.iter().map(|element| element.split_once(' ').unwrap().0);
        let found: Vec<usize> = names.map(|name| layout.at(name).unwrap()).collect();
        assert_eq!((&found[..], layout.bytes), (*places, *bytes), "{elements:?}");
    }
}

#[test]
fn an_element_of_several_numbers_is_no_column() {
    let (_fake, folder) = folder();
    let layout = layout(&["q le:s32/32X4>>0"]);
    let fault = layout.place(&folder, "q").unwrap_err().to_string();
    assert!(fault.contains("holds 4 numbers"), "{fault}");
}
