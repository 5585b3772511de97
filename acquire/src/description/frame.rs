//! The sections `[frame]`, `[[field]]`, `[items]` and `[[item]]`.

use crate::checksum::{Checksum, MAX_PAD, Parameters, Sum};
use crate::frames::{Frame, Item, Items, Length, MAX_FRAME};
use crate::number::{ByteOrder, Field, NumberType, Place};
use isotherm_shared::document::Section;

/// Most bytes that a sync may have.
const MAX_SYNC: usize = 16;
/// Places in a frame.
const PLACES: std::ops::RangeInclusive<i64> = -(MAX_FRAME as i64)..=MAX_FRAME as i64;
/// Most fields, and most items.
const MAX_FIELDS: usize = 256;

pub(super) fn read(root: &Section<'_, '_>) -> Option<Frame> {
    let section = root.section("frame", "a section [frame]");
    let items_section = root.optional_section("items");
    let (field_sections, item_sections) = (root.list("field"), root.list("item"));
    let section = section?;
    let order = section.choice("byte_order", &ByteOrder::NAMES);
    let default = order.unwrap_or(ByteOrder::Big);
    let sync = sync(&section);
    let length = length(&section, default, sync.as_ref().map_or(1, Vec::len));
    let checksum = checksum(&section, default, length);
    section.finish();
    let fixed = match length {
        Some(Length::Fixed(length)) => Some(length),
        _ => None,
    };
    let mut given = field_sections.len();
    let (fields, items) = match items_section {
        None => {
            for item in &item_sections {
                item.fault("id", "there is no section [items]; give it, or only fields");
            }
            let missing = field_sections.is_empty() && item_sections.is_empty();
            root.fault_if(missing, "field", "missing; give a section [[field]] for each number that is used");
            (fields(field_sections, default, fixed), None)
        }
        Some(section) => {
            for field in &field_sections {
                field.fault("name", "is at a fixed place; in a frame of items give [[item.field]]");
            }
            let (fields, known, of_items) = items(item_sections, default);
            given = of_items;
            let items = item_form(section, default, known);
            (fields, Some(items))
        }
    };
    let items = items.map_or(Some(None), |items| items.map(Some));
    let names: Vec<_> = fields.iter().map(|field| field.name.as_str()).collect();
    let twice = (1..names.len()).find(|at| names[..*at].contains(&names[*at]));
    root.refuse("field", twice.map(|at| format!("{} is there twice; give every field a name of its own", names[at])));
    order?;
    // A field that is wrong is none, so its columns would be missed.
    (fields.len() == given).then_some(())?;
    Some(Frame { sync: sync?, length: length?, checksum: checksum?, fields, items: items? })
}

fn sync(section: &Section<'_, '_>) -> Option<Vec<u8>> {
    section.fault_if(!section.has("sync"), "sync", "missing; give the first bytes of a frame, as in [0xFA, 0xFF]");
    let sync = section.optional_integers("sync", 0..=255)?;
    let right = (1..=MAX_SYNC).contains(&sync.len());
    section.refuse("sync", (!right).then(|| format!("has {} bytes; give 1 to {MAX_SYNC}", sync.len())));
    right.then(|| sync.into_iter().map(|byte| byte as u8).collect())
}

fn length(section: &Section<'_, '_>, order: ByteOrder, sync: usize) -> Option<Length> {
    let fixed = section.optional_integer("length", 1..=MAX_FRAME as i64);
    let stated = section.optional_section("length_field").map(|stated| {
        let at = stated.integer("at", 0..=MAX_FRAME as i64, "the place of the length in the frame");
        let number = number(&stated, "type");
        let unsigned = number.filter(|number| number.is_unsigned());
        stated.refuse(
            "type",
            number.filter(|_| unsigned.is_none()).map(|_| "is not a length; give u8, u16 or u32".to_owned()),
        );
        let order = stated.optional_choice("byte_order", &ByteOrder::NAMES).unwrap_or(order);
        let add = stated.optional_integer("add", 0..=MAX_FRAME as i64).unwrap_or(0) as usize;
        stated.finish();
        Some(Length::Stated { at: at? as usize, number: unsigned?, order, add })
    });
    match (section.has("length"), section.has("length_field")) {
        (true, true) => section.fault("length_field", "is given in addition to length; give one of them"),
        (false, false) => section
            .fault("length", "missing; give the length of a frame in bytes, sync and checksum too, or length_field"),
        _ => {}
    }
    let short = fixed.filter(|length| (*length as usize) < sync);
    section.refuse(
        "length",
        short.map(|length| format!("is {length}, and sync by itself has {sync}; give the whole frame")),
    );
    match fixed {
        Some(length) => Some(Length::Fixed(length as usize)),
        None => stated?,
    }
}

/// `Some(None)` for a frame without checksum.
pub(super) fn checksum(
    section: &Section<'_, '_>,
    order: ByteOrder,
    length: Option<Length>,
) -> Option<Option<Checksum>> {
    let section =
        section.section("checksum", "checksum = { algorithm = \"..\", at = -2 }, or { algorithm = \"none\" }")?;
    let name = section.string("algorithm", "the name of a checksum, or \"none\"")?;
    if name == "none" {
        section.finish();
        return Some(None);
    }
    let sum = sum(&section, name);
    let place = |key| section.optional_integer(key, PLACES).map(|place| Place(place as isize));
    let (at, from, to) = (place("at"), place("from"), place("to"));
    if !section.has("at") {
        section.fault("at", "missing; give the place of the checksum, as in at = -2 for the last two bytes");
    }
    let pad = section.optional_integer("pad", 1..=MAX_PAD as i64).unwrap_or(1) as usize;
    let order = section.optional_choice("byte_order", &ByteOrder::NAMES).unwrap_or(order);
    let at = at?;
    let checksum = Checksum { sum: sum?, at, order, from: from.unwrap_or(Place(0)), to: to.unwrap_or(at), pad };
    if let Some(Length::Fixed(length)) = length
        && checksum.is_right(&vec![0; length]).is_none()
    {
        section.fault(
            "at",
            format!("checksum or its bytes are not within the {length} bytes of a frame; give places inside"),
        );
    }
    section.finish();
    Some(Some(checksum))
}

fn sum(section: &Section<'_, '_>, name: &str) -> Option<Sum> {
    let flag = |key| section.optional_bool(key).unwrap_or_default();
    let parameters = |limit: i64| {
        let number = |key| section.optional_integer(key, 0..=limit);
        if !section.has("polynomial") {
            section.fault("polynomial", "missing; give it without its highest term, as in 0x1021");
        }
        let polynomial = number("polynomial");
        let (init, xorout) = (number("init").unwrap_or(0), number("xorout").unwrap_or(0));
        let (reflect_in, reflect_out) = (flag("reflect_in"), flag("reflect_out"));
        Some(Parameters { polynomial: polynomial?, init, reflect_in, reflect_out, xorout })
    };
    match name {
        "crc16" => {
            parameters(u16::MAX.into()).map(|Parameters { polynomial, init, reflect_in, reflect_out, xorout }| {
                let [polynomial, init, xorout] = [polynomial, init, xorout].map(|number| number as u16);
                Sum::crc_16(Parameters { polynomial, init, reflect_in, reflect_out, xorout })
            })
        }
        "crc32" => {
            parameters(u32::MAX.into()).map(|Parameters { polynomial, init, reflect_in, reflect_out, xorout }| {
                let [polynomial, init, xorout] = [polynomial, init, xorout].map(|number| number as u32);
                Sum::crc_32(Parameters { polynomial, init, reflect_in, reflect_out, xorout })
            })
        }
        _ => {
            let sum = Sum::of(name);
            let unknown = "give none, sum8, sum8-negative, xor8, a name of the catalogue of CRC-16 and CRC-32 as CRC-16/XMODEM, \
                           or crc16 or crc32 with polynomial, init, reflect_in, reflect_out, xorout";
            section.refuse("algorithm", sum.is_none().then(|| format!("is {name:?}; {unknown}")));
            sum
        }
    }
}

fn number(section: &Section<'_, '_>, key: &'static str) -> Option<NumberType> {
    section.choice(key, &NumberType::NAMES)
}

/// The fields of a frame or of an item, of this length if it is known.
fn fields(sections: Vec<Section<'_, '_>>, order: ByteOrder, length: Option<usize>) -> Vec<Field> {
    let mut fields = Vec::new();
    for section in sections.into_iter().take(MAX_FIELDS) {
        let name = section.string("name", "the field's name");
        let at = section.integer("at", PLACES, "its place in bytes from the beginning, or less than 0 from the end");
        let number = number(&section, "type");
        let order = section.optional_choice("byte_order", &ByteOrder::NAMES).unwrap_or(order);
        let scale = section.optional_number("scale").unwrap_or(1.0);
        let offset = section.optional_number("offset").unwrap_or(0.0);
        section.fault_if(scale == 0.0, "scale", "is 0; give what one unit of the number stands for");
        if let (Some(at), Some(number), Some(length)) = (at, number, length) {
            let begin = Place(at as isize).within(length);
            let fits = begin.is_some_and(|begin| begin + number.bytes() <= length);
            section.refuse(
                "at",
                (!fits).then(|| format!("is {at}, and the {} bytes are not within the {length}", number.bytes())),
            );
        }
        section.finish();
        if let (Some(name), Some(at), Some(number)) = (name, at, number) {
            fields.push(Field { name: name.to_owned(), at: Place(at as isize), number, order, scale, offset });
        }
    }
    fields
}

/// The items, the fields of all of them, and how many fields there should be.
fn items(sections: Vec<Section<'_, '_>>, order: ByteOrder) -> (Vec<Field>, Vec<Item>, usize) {
    let (mut all, mut known, mut given) = (Vec::new(), Vec::<Item>::new(), 0);
    for section in sections.into_iter().take(MAX_FIELDS) {
        let id = section.integer("id", 0..=i64::MAX, "that of the item");
        let length = section.integer("length", 0..=MAX_FRAME as i64, "that of the item");
        let own = section.list("field");
        section.fault_if(own.is_empty(), "field", "missing; give the numbers of the item that are used");
        let begin = all.len();
        given += own.len();
        all.extend(fields(own, order, length.map(|length| length as usize)));
        if let (Some(id), Some(length)) = (id.map(i64::cast_unsigned), length) {
            let twice = known.iter().any(|item| item.id == id);
            section.fault_if(twice, "id", "is there twice; give every item once");
            known.push(Item { id, length: length as usize, fields: begin..all.len() });
        }
        section.finish();
    }
    (all, known, given)
}

fn item_form(section: Section<'_, '_>, order: ByteOrder, known: Vec<Item>) -> Option<Items> {
    let expected = "where the items begin and, less than 0 from the end of the frame, where they end";
    let at = section.integer("at", 0..=MAX_FRAME as i64, expected);
    let end = section.integer("end", PLACES, expected);
    let [id, length] = ["id", "length"].map(|key| {
        let number = number(&section, key);
        let unsigned = number.filter(|number| number.is_unsigned());
        section
            .refuse(key, number.filter(|_| unsigned.is_none()).map(|_| "has a sign; give u8, u16 or u32".to_owned()));
        unsigned
    });
    let order = section.optional_choice("byte_order", &ByteOrder::NAMES).unwrap_or(order);
    section.finish();
    Some(Items { at: at? as usize, end: Place(end? as isize), id: id?, length: length?, order, known })
}
