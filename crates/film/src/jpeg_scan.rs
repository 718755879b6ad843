//! Whether the scans of a JPEG file hold all coefficients of its image (ITU-T T.81, Annexes F and
//! G). The values of the coefficients are passed over.

#![warn(clippy::cast_possible_truncation)]

use crate::jpeg_segments::{SOS, Segments};

/// The most blocks of a channel of a progressive image that are followed, with 8 bytes each.
const MOST_BLOCKS: usize = 1 << 23;

/// The most bits of a coefficient, or of a run of blocks.
const MOST_BITS: u32 = 16;

/// The largest number of scans that are followed. Programs write about ten.
const MOST_SCANS: usize = 200;

/// The place behind the data of the scan that completes the image of this file. `None` if a
/// coefficient is missing, or if the file is damaged or has another coding.
pub(crate) fn end(bytes: &[u8]) -> Option<usize> {
    let mut image = Image::default();
    let mut scans = 0;
    for segment in Segments::of(bytes) {
        match segment.code {
            0xc0..=0xc2 => image.start_frame(segment.code == 0xc2, segment.content)?,
            0xc4 => image.define_tables(segment.content)?,
            // Frames without Huffman codes, and lossless or hierarchical ones.
            0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => return None,
            0xdd => image.restart = u16_at(segment.content, 0)?.into(),
            SOS => {
                scans += 1;
                let mut bits = Bits { bytes, at: segment.end, hold: 0, count: 0 };
                image.pass_scan(segment.content, &mut bits)?;
                if image.is_complete() {
                    return bits.is_end().then_some(bits.at);
                }
                if scans == MOST_SCANS {
                    return None;
                }
            }
            _ => {}
        }
    }
    None
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..)?.first_chunk().map(|pair| u16::from_be_bytes(*pair))
}

/// The data of a scan, read bit by bit.
struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    /// The last byte, and how many of its bits are left.
    hold: u8,
    count: u32,
}

impl Bits<'_> {
    /// The next bit; `None` at the end of the file and in front of a marker.
    fn bit(&mut self) -> Option<usize> {
        if self.count == 0 {
            let byte = *self.bytes.get(self.at)?;
            if byte == 0xff && self.bytes.get(self.at + 1) != Some(&0) {
                return None;
            }
            self.at += if byte == 0xff { 2 } else { 1 };
            (self.hold, self.count) = (byte, 8);
        }
        self.count -= 1;
        Some(usize::from((self.hold >> self.count) & 1))
    }

    /// A number of so many bits; `None` for more than a coefficient has: the file is damaged.
    fn number(&mut self, bits: u32) -> Option<usize> {
        (bits <= MOST_BITS).then_some(())?;
        (0..bits).try_fold(0, |number, _| Some(2 * number + self.bit()?))
    }

    /// Passes over the marker between two parts of a scan.
    fn restart(&mut self) -> Option<()> {
        self.count = 0;
        let rest = self.bytes.get(self.at..)?;
        let fill = rest.iter().position(|byte| *byte != 0xff)?;
        self.at += fill + 1;
        (fill > 0 && (0xd0..=0xd7).contains(&rest[fill])).then_some(())
    }

    /// Whether a scan can end here: in front of a marker or the end of the file, or behind a byte
    /// that is filled up with ones. Zeros may be those of a file whose rest was never written.
    fn is_end(&self) -> bool {
        let is_filled = self.count > 0 && self.hold.trailing_ones() >= self.count;
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        is_filled || matches!(rest, [] | [0xff] | [0xff, 1..=u8::MAX, ..])
    }
}

/// A Huffman table.
#[derive(Clone, Debug)]
struct Table {
    /// The number of codes of each length from 1 to 16.
    counts: [u8; 16],
    symbols: Vec<u8>,
}

impl Table {
    fn symbol(&self, bits: &mut Bits<'_>) -> Option<u8> {
        // The code so far, the first code of its length, and the index of that code's symbol.
        let (mut code, mut first, mut index) = (0, 0, 0);
        for count in self.counts {
            code += bits.bit()?;
            let count = usize::from(count);
            if code < first + count {
                return self.symbols.get(index + code.checked_sub(first)?).copied();
            }
            index += count;
            first = 2 * (first + count);
            code *= 2;
        }
        None
    }
}

/// A colour channel.
#[derive(Clone, Debug)]
struct Component {
    id: u8,
    /// Blocks in a unit of the image, by columns and rows.
    sampling: [usize; 2],
    /// Blocks of the channel alone, by columns and rows.
    blocks: [usize; 2],
    /// Blocks in a row, filled up to whole units.
    stride: usize,
    /// The lowest bit that is known of each coefficient.
    known: [u8; 64],
    /// For a progressive image, a bit for each coefficient of each block that is not 0.
    nonzero: Vec<u64>,
}

impl Component {
    /// The number of blocks, filled up to whole units.
    fn all_blocks(&self, units: [usize; 2]) -> usize {
        self.stride * units[1] * self.sampling[1]
    }
}

/// The state between two segments.
#[derive(Debug, Default)]
struct Image {
    progressive: bool,
    /// Units of the image, by columns and rows.
    units: [usize; 2],
    components: Vec<Component>,
    /// Tables of the mean values and of the others.
    tables: [[Option<Table>; 4]; 2],
    /// Units between two restarts; 0 if there are none.
    restart: usize,
}

/// The coefficients of a scan: from the first to the last one, and from the highest bit that was
/// known (0: none) to the lowest bit that is known then.
#[derive(Clone, Copy)]
struct Band {
    first: usize,
    last: usize,
    high: u8,
}

impl Image {
    fn start_frame(&mut self, progressive: bool, content: &[u8]) -> Option<()> {
        let &[_, y0, y1, x0, x1, count, ..] = content else { return None };
        let size = [u16::from_be_bytes([x0, x1]), u16::from_be_bytes([y0, y1])].map(usize::from);
        let parts: Vec<&[u8]> = content[6..].chunks_exact(3).take(count.into()).collect();
        let samplings = || parts.iter().map(|p| [p[1] >> 4, p[1] & 15].map(usize::from));
        let is_valid = samplings().flatten().all(|s| (1..=4).contains(&s));
        let is_first = self.components.is_empty() && (1..=4).contains(&count);
        if !is_valid || !is_first || parts.len() != usize::from(count) || size.contains(&0) {
            return None;
        }
        let most = |axis: usize| samplings().map(|s| s[axis]).max().unwrap_or(1);
        let most = [most(0), most(1)];
        self.progressive = progressive;
        self.units = [0, 1].map(|axis| size[axis].div_ceil(8 * most[axis]));
        self.components = parts
            .iter()
            .zip(samplings())
            .map(|(part, sampling)| Component {
                id: part[0],
                sampling,
                blocks: [0, 1].map(|a| (size[a] * sampling[a]).div_ceil(most[a]).div_ceil(8)),
                stride: self.units[0] * sampling[0],
                known: [u8::MAX; 64],
                nonzero: Vec::new(),
            })
            .collect();
        Some(())
    }

    fn define_tables(&mut self, mut content: &[u8]) -> Option<()> {
        while let Some((&kind, rest)) = content.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>()?;
            let (symbols, rest) =
                rest.split_at_checked(counts.iter().map(|n| usize::from(*n)).sum())?;
            let table = Table { counts: *counts, symbols: symbols.to_vec() };
            let place = self.tables.get_mut(usize::from(kind >> 4))?;
            *place.get_mut(usize::from(kind & 15))? = Some(table);
            content = rest;
        }
        Some(())
    }

    /// Whether the last bit of every coefficient is known.
    fn is_complete(&self) -> bool {
        !self.components.is_empty() && self.components.iter().all(|c| c.known == [0; 64])
    }

    /// Passes over the data of a scan with this header.
    fn pass_scan(&mut self, header: &[u8], bits: &mut Bits<'_>) -> Option<()> {
        let (&count, rest) = header.split_first()?;
        let (chosen, rest) = rest.split_at_checked(2 * usize::from(count))?;
        let &[first, last, bit, ..] = rest else { return None };
        let band = match self.progressive {
            true => Band { first: first.into(), last: last.into(), high: bit >> 4 },
            false => Band { first: 0, last: 63, high: 0 },
        };
        let low = if self.progressive { bit & 15 } else { 0 };
        // The mean values have scans of their own in a progressive image.
        let is_valid = band.first <= band.last && band.last < 64;
        let is_alone = band.first > 0 || band.last == 0;
        if !is_valid || (self.progressive && !is_alone) || !(1..=4).contains(&count) {
            return None;
        }
        let mut parts = Vec::new();
        for pair in chosen.chunks_exact(2) {
            let index = self.components.iter().position(|c| c.id == pair[0])?;
            parts.push((index, usize::from(pair[1] >> 4), usize::from(pair[1] & 15)));
            self.components[index].known[band.first..=band.last].fill(low);
        }
        if self.progressive && band.first > 0 {
            let &[(index, _, table)] = parts.as_slice() else { return None };
            return self.pass_details(index, table, band, bits);
        }
        self.pass_units(&parts, band, bits)
    }

    /// Passes over a scan of mean values, or of whole blocks.
    fn pass_units(
        &self,
        parts: &[(usize, usize, usize)],
        band: Band,
        bits: &mut Bits<'_>,
    ) -> Option<()> {
        let mut blocks = Vec::new();
        for &(index, mean, other) in parts {
            let tables = [self.tables[0].get(mean)?.as_ref(), self.tables[1].get(other)?.as_ref()];
            let [across, down] = self.components[index].sampling;
            let in_unit = if parts.len() == 1 { 1 } else { across * down };
            blocks.resize(blocks.len() + in_unit, tables);
        }
        let [across, down] = match parts {
            &[(index, ..)] => self.components[index].blocks,
            _ => self.units,
        };
        for unit in 0..across * down {
            if self.is_restart(unit) {
                bits.restart()?;
            }
            for &[mean, other] in &blocks {
                if band.high > 0 {
                    bits.bit()?;
                    continue;
                }
                let size = mean?.symbol(bits)?;
                bits.number(size.into())?;
                if band.last > 0 {
                    pass_block(other?, bits)?;
                }
            }
        }
        Some(())
    }

    fn is_restart(&self, unit: usize) -> bool {
        self.restart > 0 && unit > 0 && unit.is_multiple_of(self.restart)
    }

    /// Passes over a scan of other coefficients of one channel of a progressive image.
    fn pass_details(
        &mut self,
        index: usize,
        table: usize,
        band: Band,
        bits: &mut Bits<'_>,
    ) -> Option<()> {
        let table = self.tables[1].get(table)?.clone()?;
        let component = &mut self.components[index];
        let all = component.all_blocks(self.units);
        if all > MOST_BLOCKS {
            return None;
        }
        let mut nonzero = std::mem::take(&mut component.nonzero);
        nonzero.resize(all, 0);
        let ([across, down], stride) = (component.blocks, component.stride);
        let mut run = 0;
        for unit in 0..across * down {
            if self.is_restart(unit) {
                bits.restart()?;
                run = 0;
            }
            let block = &mut nonzero[unit / across * stride + unit % across];
            match band.high {
                0 => first_details(&table, band, &mut run, block, bits)?,
                _ => finer_details(&table, band, &mut run, block, bits)?,
            }
        }
        self.components[index].nonzero = nonzero;
        Some(())
    }
}

/// Passes over the coefficients of a block behind its mean value.
fn pass_block(table: &Table, bits: &mut Bits<'_>) -> Option<()> {
    let mut at = 1;
    while at < 64 {
        let symbol = table.symbol(bits)?;
        let (zeros, size) = (symbol >> 4, symbol & 15);
        if size == 0 && zeros < 15 {
            return Some(());
        }
        at += usize::from(zeros) + 1;
        bits.number(size.into())?;
    }
    (at == 64).then_some(())
}

/// Passes over the higher bits of a block; `run` counts the blocks that are 0 from here on.
fn first_details(
    table: &Table,
    band: Band,
    run: &mut usize,
    block: &mut u64,
    bits: &mut Bits<'_>,
) -> Option<()> {
    if *run > 0 {
        *run -= 1;
        return Some(());
    }
    let mut at = band.first;
    while at <= band.last {
        let symbol = table.symbol(bits)?;
        let (zeros, size) = (symbol >> 4, symbol & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) - 1 + bits.number(zeros.into())?;
            return Some(());
        }
        at += usize::from(zeros);
        if size > 0 {
            *block |= 1u64.checked_shl(u32::try_from(at).ok()?)?;
            bits.number(size.into())?;
        }
        at += 1;
    }
    Some(())
}

/// Passes over the next bit of the coefficients of a block: each that is not 0 has one.
fn finer_details(
    table: &Table,
    band: Band,
    run: &mut usize,
    block: &mut u64,
    bits: &mut Bits<'_>,
) -> Option<()> {
    let is_nonzero = |block: u64, at: usize| (block >> at) & 1 == 1;
    let mut at = band.first;
    while *run == 0 && at <= band.last {
        let symbol = table.symbol(bits)?;
        let (mut zeros, size) = (symbol >> 4, symbol & 15);
        if size == 0 && zeros < 15 {
            *run = (1 << zeros) + bits.number(zeros.into())?;
            break;
        }
        if size > 0 {
            bits.bit()?;
        }
        while at <= band.last && (is_nonzero(*block, at) || zeros > 0) {
            if is_nonzero(*block, at) {
                bits.bit()?;
            } else {
                zeros -= 1;
            }
            at += 1;
        }
        if size > 0 && at <= band.last {
            *block |= 1 << at;
        }
        at += 1;
    }
    if *run > 0 {
        for _ in (at..=band.last).filter(|at| is_nonzero(*block, *at)) {
            bits.bit()?;
        }
        *run -= 1;
    }
    Some(())
}
