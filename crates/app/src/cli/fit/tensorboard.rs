//! The metrics of a fit as events of TensorBoard, `--log tensorboard`.
//!
//! A file is a sequence of records (TensorFlow's "TFRecord": length, checksum of the length, data,
//! checksum of the data). The data are messages `Event` of `event.proto`, in the encoding of
//! protocol buffers.

use std::fs::{File, create_dir_all};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use files::WriteError;
use fit::Metrics;

/// Events come to the disk at least this often.
const FLUSH: Duration = Duration::from_secs(2);

/// The events of one process.
pub(super) struct Events {
    path: PathBuf,
    writer: BufWriter<File>,
    flushed: Instant,
}

impl Events {
    /// Starts a file of events in the run folder, for the iterations after this one. TensorBoard
    /// forgets what earlier files have of later iterations: a killed fit repeats these.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn start(run: &Path, iteration: u64) -> Result<Self, WriteError> {
        let folder = run.join("tensorboard");
        create_dir_all(&folder).map_err(|e| WriteError::of_file(&folder, e))?;
        let now = seconds();
        // TensorBoard reads the files of a folder in the order of their names.
        let name = format!("events.out.tfevents.{:010}.{:010}.dsdf", now as u64, iteration);
        let path = folder.join(name);
        let file = File::create(&path).map_err(|e| WriteError::of_file(&path, e))?;
        let mut events = Events { path, writer: BufWriter::new(file), flushed: Instant::now() };
        let version = event(now, 0, |out| text(out, 3, "brain.Event:2"));
        let start = event(now, iteration + 1, |out| message(out, 7, |out| varint(out, 1, 1)));
        events.append(&[version, start], true)?;
        Ok(events)
    }

    /// Adds the numbers of an iteration.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(super) fn add(&mut self, metrics: &Metrics) -> Result<(), WriteError> {
        let step = &metrics.step;
        let scalars = [
            ("loss", Some(step.loss)),
            ("eikonal", Some(step.eikonal)),
            ("psnr/training pixels", Some(step.train_psnr)),
            ("psnr/preview", metrics.psnr),
            ("gradient norm", Some(step.gradient_norm)),
            ("rays per second", Some(metrics.rays_per_second)),
            ("level", Some(step.level as f64)),
        ];
        let own = event(seconds(), step.iteration, |out| {
            message(out, 5, |out| {
                for (tag, value) in scalars {
                    let Some(value) = value else { continue };
                    message(out, 1, |out| {
                        text(out, 1, tag);
                        out.push(2 << 3 | FIXED_32);
                        out.extend_from_slice(&(value as f32).to_le_bytes());
                    });
                }
            });
        });
        let is_due = self.flushed.elapsed() >= FLUSH;
        self.append(&[own], is_due)
    }

    fn append(&mut self, events: &[Vec<u8>], flush: bool) -> Result<(), WriteError> {
        let write = |writer: &mut BufWriter<File>| {
            for event in events {
                let length = (event.len() as u64).to_le_bytes();
                writer.write_all(&length)?;
                writer.write_all(&masked(crc32c(&length)).to_le_bytes())?;
                writer.write_all(event)?;
                writer.write_all(&masked(crc32c(event)).to_le_bytes())?;
            }
            if flush { writer.flush() } else { Ok(()) }
        };
        if flush {
            self.flushed = Instant::now();
        }
        write(&mut self.writer).map_err(|e| WriteError::of_file(&self.path, e))
    }
}

/// Seconds since 1970.
fn seconds() -> f64 {
    SystemTime::UNIX_EPOCH.elapsed().map_or(0.0, |time| time.as_secs_f64())
}

/// Types of fields in protocol buffers.
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const BYTES: u8 = 2;
const FIXED_32: u8 = 5;

/// An event: its time, its iteration and its content.
fn event(time: f64, step: u64, content: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut out = vec![1 << 3 | FIXED_64];
    out.extend_from_slice(&time.to_le_bytes());
    varint(&mut out, 2, step);
    content(&mut out);
    out
}

fn varint(out: &mut Vec<u8>, field: u8, value: u64) {
    out.push(field << 3 | VARINT);
    push_varint(out, value);
}

fn push_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn bytes(out: &mut Vec<u8>, field: u8, value: &[u8]) {
    out.push(field << 3 | BYTES);
    push_varint(out, value.len() as u64);
    out.extend_from_slice(value);
}

fn text(out: &mut Vec<u8>, field: u8, value: &str) {
    bytes(out, field, value.as_bytes());
}

fn message(out: &mut Vec<u8>, field: u8, content: impl FnOnce(&mut Vec<u8>)) {
    let mut inner = Vec::new();
    content(&mut inner);
    bytes(out, field, &inner);
}

/// The checksum CRC-32C (Castagnoli) of bytes.
fn crc32c(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut i = 0;
        while i < 256 {
            let (mut value, mut bit) = (i as u32, 0);
            while bit < 8 {
                value = value >> 1 ^ if value & 1 == 1 { 0x82f6_3b78 } else { 0 };
                bit += 1;
            }
            table[i] = value;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum: u32, byte| sum >> 8 ^ TABLE[(sum as u8 ^ byte) as usize])
}

/// A checksum as a record has it: those of data that have checksums in them would be weak.
fn masked(sum: u32) -> u32 {
    sum.rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_checksums_have_the_bytes_of_the_specifications() {
        // The check value of the catalogue of CRCs.
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
        // The example of the encoding of protocol buffers.
        let mut out = Vec::new();
        varint(&mut out, 1, 150);
        assert_eq!(out, [0x08, 0x96, 0x01]);
        out.clear();
        text(&mut out, 2, "testing");
        assert_eq!(out, *b"\x12\x07testing");
    }
}
