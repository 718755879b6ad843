//! Parts of consecutive pixels.

/// Parts of a batch: each has some consecutive pixels.
pub(crate) struct PixelParts {
    /// The first pixel of each part.
    first: Vec<u32>,
    /// The part of each pixel.
    part: Vec<u32>,
}

impl PixelParts {
    /// Parts with these numbers of pixels.
    pub(crate) fn new(sizes: &[usize]) -> Self {
        let (mut first, mut part) = (Vec::with_capacity(sizes.len()), Vec::new());
        for (number, size) in sizes.iter().enumerate() {
            first.push(part.len() as u32);
            part.resize(part.len() + size, number as u32);
        }
        PixelParts { first, part }
    }

    /// The number of parts.
    pub(crate) fn count(&self) -> usize {
        self.first.len()
    }

    /// The part of a pixel.
    pub(crate) fn of(&self, pixel: u32) -> usize {
        self.part[pixel as usize] as usize
    }

    /// The first pixel of a part.
    pub(crate) fn first(&self, part: usize) -> u32 {
        self.first[part]
    }
}
