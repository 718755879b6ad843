//! Images: PNG, JPEG, TIFF, WebP, EXR and arrays.

use std::io::Write;

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::webp::WebPEncoder;
use proptest::prelude::*;

use crate::case::Case;
use crate::formats::arrays::{array_images, deflated};
use crate::layout::Layout;
use crate::spoil::{self, Spoil, spoiled};

/// A chunk of a PNG file.
#[derive(Clone, Debug)]
struct Chunk {
    kind: [u8; 4],
    body: Layout,
    /// A wrong length in place of the right one.
    length: Option<u64>,
}

/// A PNG file: its chunks.
#[derive(Clone, Debug)]
struct Png {
    chunks: Vec<Chunk>,
}

impl Png {
    fn to_bytes(&self) -> Vec<u8> {
        let mut out = Layout::big_endian().bytes(*b"\x89PNG\r\n\x1a\n");
        for Chunk { kind, body, length } in &self.chunks {
            let body = body.to_bytes();
            let mut crc = Crc::new();
            crc.update(kind);
            crc.update(&body);
            out = out
                .integer(length.unwrap_or(body.len() as u64), 4)
                .bytes(*kind)
                .bytes(body)
                .integer(crc.sum().into(), 4);
        }
        out.to_bytes()
    }
}

impl Spoil for Png {
    fn spoil(&mut self, place: usize, harm: usize) {
        if self.chunks.is_empty() {
            return;
        }
        let i = place / 3 % self.chunks.len();
        match harm % 24 {
            0 => drop(self.chunks.remove(i)),
            1 => self.chunks.insert(i, self.chunks[i].clone()),
            2 => self.chunks[i].kind = *b"abCd",
            3 | 4 => {
                let right = self.chunks[i].body.to_bytes().len() as u64;
                self.chunks[i].length = Some(spoil::integer(right, harm / 24));
            }
            // Every third place is in the header.
            _ if place.is_multiple_of(3) => self.chunks[0].body.spoil(place / 3, harm / 24),
            _ => self.chunks[i].body.spoil(place / 3 / 7, harm / 24),
        }
    }
}

fn zlib(data: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    let written = encoder.write_all(data);
    debug_assert!(written.is_ok(), "a vector takes every byte");
    encoder.finish().unwrap_or_default()
}

/// The header of a PNG file.
fn header(size: [u32; 2], colour: u8, depth: u8) -> Layout {
    Layout::big_endian()
        .integer(size[0].into(), 4)
        .integer(size[1].into(), 4)
        .integer(depth.into(), 1)
        .integer(colour.into(), 1)
        .integer(0, 1)
        .integer(0, 1)
        .integer(0, 1)
}

/// A PNG file of this size, colour type and bits of a channel; all its bytes are `byte`.
fn png(size: [u32; 2], colour: u8, depth: u8, byte: u8, extra: usize) -> Png {
    let channels = match colour {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    let row = (size[0] as usize * channels * usize::from(depth)).div_ceil(8);
    let rows = [&[0][..], &vec![byte; row]].concat().repeat(size[1] as usize);
    let chunk = |kind: &[u8; 4], body: Layout| Chunk { kind: *kind, body, length: None };
    let start = Layout::big_endian();
    let mut chunks = vec![chunk(b"IHDR", header(size, colour, depth))];
    // A profile or a text that inflates to 32 MiB.
    let bomb = || [&[0x78, 0x01][..], &deflated(b"", 32)].concat();
    match extra {
        0 => chunks.push(chunk(b"gAMA", start.clone().integer(45455, 4))),
        1 => chunks.push(chunk(b"tEXt", start.clone().bytes(*b"Title\0a \x1b[31m"))),
        2 => chunks.push(chunk(b"iCCP", start.clone().bytes(*b"p\0\0").bytes(bomb()))),
        3 => chunks.push(chunk(b"zTXt", start.clone().bytes(*b"t\0\0").bytes(bomb()))),
        _ => {}
    }
    if colour == 3 {
        chunks.push(chunk(b"PLTE", start.clone().bytes(vec![byte; 3 << depth])));
        chunks.push(chunk(b"tRNS", start.clone().bytes(vec![byte; 1 << depth])));
    }
    chunks.push(chunk(b"IDAT", start.clone().bytes(zlib(&rows))));
    chunks.push(chunk(b"IEND", start));
    Png { chunks }
}

/// A PNG photograph of this size with 8 bits a channel; with alpha, half of it is transparent.
pub(crate) fn photograph(size: [u32; 2], alpha: bool) -> Vec<u8> {
    png(size, if alpha { 6 } else { 2 }, 8, 100, 9).to_bytes()
}

/// A black PNG file of one bit a pixel; its image data have a thousandth of their length.
fn large_png(width: u32, height: u32) -> Png {
    let mut png = png([width, 1], 0, 1, 0, 9);
    let bytes = (width.div_ceil(8) as usize + 1) * height as usize;
    let data = [&[0x78, 0x01][..], &deflated(b"", bytes.div_ceil(1 << 20))].concat();
    png.chunks[0].body = header([width, height], 0, 1);
    png.chunks[1].body = Layout::big_endian().bytes(data);
    png
}

fn pngs() -> impl Strategy<Value = Png> + Clone {
    let kinds = prop::sample::select(vec![
        (0u8, 1u8),
        (0, 8),
        (0, 16),
        (2, 8),
        (2, 16),
        (3, 1),
        (3, 4),
        (3, 8),
        (4, 8),
        (6, 8),
        (6, 16),
    ]);
    // One in forty has 400 million pixels, in some kilobytes.
    let sides = prop_oneof![39 => (1..12u32, 1..12u32), 1 => Just((20_000, 20_000))];
    (kinds, sides, any::<u8>(), 0..16usize).prop_map(|((colour, depth), (w, h), byte, extra)| {
        if w * h > 1000 { large_png(w, h) } else { png([w, h], colour, depth, byte, extra) }
    })
}

/// A colour profile like that of Adobe RGB: a header, and a list of tags.
fn profile() -> Layout {
    let header = Layout::big_endian().integer(356, 4).integer(0, 4).integer(0x0240_0000, 4);
    let header = header.bytes(*b"mntr").bytes(*b"RGB ").bytes(*b"XYZ ").bytes([0; 12]);
    let header = header.bytes(*b"acsp").bytes([0; 24]).integer(1, 4);
    let header = header.integer(0xf6d6, 4).integer(0x10000, 4).integer(0xd32d, 4).bytes([0; 48]);
    // The primaries have 20 bytes each, and the curve of all three 14.
    let places = [(b"rXYZ", 204, 20), (b"gXYZ", 224, 20), (b"bXYZ", 244, 20)];
    let curves = [(b"rTRC", 264, 14), (b"gTRC", 264, 14), (b"bTRC", 264, 14)];
    let tags = [places, curves].concat();
    let list = tags.into_iter().fold(header.integer(6, 4), |list, (name, place, length)| {
        list.bytes(*name).integer(place, 4).integer(length, 4)
    });
    let primaries = [[0x9c18, 0x4fa5, 0x4fc], [0x348d, 0xa02c, 0xf95], [0x2631, 0x102f, 0xbe9c]];
    let data = primaries.into_iter().fold(list, |data, xyz| {
        xyz.into_iter().fold(data.bytes(*b"XYZ \0\0\0\0"), |data, v| data.integer(v, 4))
    });
    data.bytes(*b"curv\0\0\0\0").integer(1, 4).integer(0x0233, 2).bytes([0; 78])
}

/// A PNG photograph with a colour profile that may be harmed.
fn profiled_pngs() -> impl Strategy<Value = Vec<u8>> {
    let sizes = (1..9u32, 1..9u32);
    let kinds = prop::sample::select(vec![(0u8, 8u8), (0, 16), (2, 8), (2, 16), (6, 8), (4, 8)]);
    (spoiled(Just(profile())), sizes, kinds).prop_map(|(profile, (w, h), (colour, depth))| {
        let mut png = png([w, h], colour, depth, 100, 9);
        let body = [&b"p\0\0"[..], &zlib(&profile.to_bytes())].concat();
        let body = Layout::big_endian().bytes(body);
        png.chunks.insert(1, Chunk { kind: *b"iCCP", body, length: None });
        png.to_bytes()
    })
}

/// A JPEG file by its segments. It has its end, or none, or a profile, or data behind its end.
fn jpeg(width: u32, height: u32, quality: u8, kind: u8) -> Layout {
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([x * 37 + y * 11, x * 5 + y * 71, x * y].map(|v| (v % 256) as u8))
    });
    let mut bytes = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
    let prepared = match kind {
        2 => encoder.set_icc_profile(profile().to_bytes()).is_ok(),
        _ => true,
    };
    let encoded = encoder.encode_image(&image);
    debug_assert!(prepared && encoded.is_ok(), "a vector takes every byte");
    match kind {
        0 => bytes.truncate(bytes.len().saturating_sub(2)),
        1 => bytes.extend(b"\0\0\0\x18ftypmp42\xff\xda\0\x08\xff\xd8"),
        _ => {}
    }
    let mut layout = Layout::big_endian();
    let mut at = 0;
    while let Some(&[0xff, marker]) = bytes.get(at..at + 2).and_then(|m| m.first_chunk()) {
        layout = layout.integer(0xff00 | u64::from(marker), 2);
        at += 2;
        // The start of the image has no content.
        if marker == 0xd8 {
            continue;
        }
        let Some(length) = bytes.get(at..at + 2) else { break };
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        layout = layout.integer(length as u64, 2);
        let body = bytes.get(at + 2..at + length).unwrap_or_default();
        layout = body.iter().take(24).fold(layout, |l, b| l.integer((*b).into(), 1));
        layout = layout.bytes(body.get(24..).unwrap_or_default());
        at += length;
        // After the start of a scan come its data.
        if marker == 0xda {
            break;
        }
    }
    layout.bytes(bytes.get(at..).unwrap_or_default())
}

/// A TIFF file with one strip and without compression.
fn tiff(width: u64, height: u64, channels: u64, depth: u64, compression: u64) -> Layout {
    let format = if depth > 16 { 3 } else { 1 };
    let length = width * height * channels * depth / 8;
    let mut file = Layout::default().bytes(*b"II*\0").integer(24 + length, 4);
    for value in [depth; 4].into_iter().chain([format; 4]) {
        file = file.integer(value, 2);
    }
    file = file.bytes((0..length).map(|i| (i * 37 % 64) as u8).collect::<Vec<u8>>());
    let colour = if channels < 3 { 1 } else { 2 };
    // Values of more than four bytes are in front of the pixels.
    let shorts = |value: u64, place: u64| match channels {
        1 | 2 => value * 0x1_0001,
        _ => place,
    };
    let entries = [
        (256, 3, 1, width),
        (257, 3, 1, height),
        (258, 3, channels, shorts(depth, 8)),
        (259, 3, 1, compression),
        (262, 3, 1, colour),
        (273, 4, 1, 24),
        (274, 3, 1, 6),
        (277, 3, 1, channels),
        (278, 3, 1, height),
        (279, 4, 1, length),
        (338, 3, 1, 2 - channels % 2),
        (339, 3, channels, shorts(format, 16)),
    ];
    file = file.integer(entries.len() as u64, 2);
    file = entries.into_iter().fold(file, |file, (tag, kind, count, value)| {
        file.integer(tag, 2).integer(kind, 2).integer(count, 4).integer(value, 4)
    });
    file.integer(0, 4)
}

fn tiffs() -> impl Strategy<Value = Layout> + Clone {
    let depths = prop::sample::select(vec![8u64, 16, 32, 64]);
    let compressions =
        prop_oneof![7 => Just(1u64), 1 => prop::sample::select(vec![4u64, 5, 7, 8, 32773])];
    (1..7u64, 1..7u64, 1..5u64, depths, compressions)
        .prop_map(|(w, h, channels, depth, compression)| tiff(w, h, channels, depth, compression))
}

/// A WebP file: its header, and its only chunk.
fn webp(width: u32, height: u32) -> Layout {
    let image = image::RgbImage::from_fn(width, height, |x, y| {
        image::Rgb([x * 37 + y * 11, x * 5 + y * 71, x * y].map(|v| (v % 256) as u8))
    });
    let mut bytes = Vec::new();
    let encoded = image.write_with_encoder(WebPEncoder::new_lossless(&mut bytes));
    debug_assert!(encoded.is_ok(), "a vector takes every byte");
    let length = bytes.len() as u64;
    let layout = Layout::default().bytes(*b"RIFF").integer(length - 8, 4).bytes(*b"WEBP");
    let layout = layout.bytes(*b"VP8L").integer(length - 20, 4);
    bytes.get(20..).unwrap_or_default().iter().fold(layout, |l, b| l.integer((*b).into(), 1))
}

/// An EXR file without compression, of 32 bits a channel.
fn exr(width: u64, height: u64, channels: &[&str]) -> Layout {
    let text = |layout: Layout, text: &str| layout.bytes([text.as_bytes(), b"\0"].concat());
    let attribute = |layout: Layout, name: &str, kind: &str, size: u64| {
        text(text(layout, name), kind).integer(size, 4)
    };
    let list = channels.iter().fold(Layout::default(), |layout, name| {
        text(layout, name).integer(2, 4).integer(0, 4).integer(1, 4).integer(1, 4)
    });
    let list = list.bytes([0]);
    let window = |layout: Layout| {
        layout.integer(0, 4).integer(0, 4).integer(width - 1, 4).integer(height - 1, 4)
    };
    let mut file = Layout::default().integer(20_000_630, 4).integer(2, 4);
    file = attribute(file, "channels", "chlist", list.to_bytes().len() as u64).append(list);
    file = attribute(file, "compression", "compression", 1).integer(0, 1);
    file = window(attribute(file, "dataWindow", "box2i", 16));
    file = window(attribute(file, "displayWindow", "box2i", 16));
    file = attribute(file, "lineOrder", "lineOrder", 1).integer(0, 1);
    file = attribute(file, "pixelAspectRatio", "float", 4).float(1.0, 4);
    file = attribute(file, "screenWindowCenter", "v2f", 8).float(0.0, 4).float(0.0, 4);
    file = attribute(file, "screenWindowWidth", "float", 4).float(1.0, 4).bytes([0]);
    let (start, line) = (file.to_bytes().len() as u64, 4 * width * channels.len() as u64);
    for y in 0..height {
        file = file.integer(start + 8 * height + y * (8 + line), 8);
    }
    (0..height).fold(file, |file, y| {
        let file = file.integer(y, 4).integer(line, 4);
        (0..line / 4).fold(file, |file, x| file.float(0.1 * x as f64, 4))
    })
}

fn exrs() -> impl Strategy<Value = Layout> + Clone {
    let channels = prop::sample::select(vec![&["B", "G", "R"][..], &["A", "B", "G", "R"], &["Y"]]);
    (1..7u64, 1..7u64, channels).prop_map(|(w, h, channels)| exr(w, h, channels))
}

/// The bytes of a harmed PNG image.
pub(crate) fn png_bytes() -> BoxedStrategy<Vec<u8>> {
    spoiled(pngs()).prop_map(|png| png.to_bytes()).boxed()
}

/// A file `image.png`, `image.jpg`, `image.tif`, `image.webp`, `image.exr` or `image.npy`.
pub(crate) fn image_files() -> BoxedStrategy<Case> {
    let jpegs = (1..20u32, 1..20u32, 1..100u8, 0..6u8).prop_map(|(w, h, q, k)| jpeg(w, h, q, k));
    let webps = (1..9u32, 1..9u32).prop_map(|(w, h)| webp(w, h));
    let named = |name: &'static str| move |bytes: Vec<u8>| Case::default().file(name, bytes);
    prop_oneof![
        3 => png_bytes().prop_map(named("image.png")),
        1 => profiled_pngs().prop_map(named("image.png")),
        2 => spoiled(tiffs()).prop_map(|l| l.to_bytes()).prop_map(named("image.tif")),
        1 => spoiled(webps).prop_map(|l| l.to_bytes()).prop_map(named("image.webp")),
        3 => spoiled(jpegs).prop_map(|l| l.to_bytes()).prop_map(named("image.jpg")),
        3 => spoiled(exrs()).prop_map(|l| l.to_bytes()).prop_map(named("image.exr")),
        1 => array_images().prop_map(named("image.npy")),
    ]
    .boxed()
}
