//! The purposes of random numbers.

/// The decision that a random number is for.
///
/// Streams of different purposes share no number: every use of random numbers has a purpose of its
/// own here. A crate outside dsdf uses [`Purpose::Other`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Purpose {
    /// The seed of an independent replicate of an image.
    Replicate,
    /// The seed of the image that gives the adjoints of a target gradient.
    TargetImage,
    /// The seed of the samples that a target gradient differentiates.
    TargetSamples,
    /// Film positions in a pixel.
    PixelSamples,
    /// Film positions on an edge between pixels.
    EdgeSamples,
    /// Lines across a pixel.
    Lines,
    /// Auxiliary rays around a film position.
    AuxiliaryRays,
    /// The shift of a cloud of auxiliary rays.
    AuxiliaryShift,
    /// Directions in the space of a network's weights.
    WeightDirection,
    /// The seed of the initial weights of a radiance head.
    InitialRadiance,
    /// The permutations in which a fit draws pixels.
    PixelOrder,
    /// The rounds of one such permutation.
    Permutation,
    /// The pixel that stands for a group of background pixels.
    BackgroundPixel,
    /// The seed of an iteration of a fit.
    Iteration,
    /// The seed of a part of the batch of an iteration.
    Part,
    /// The film position of a fit's sample in its pixel.
    FitSamples,
    /// The seed of the estimator's samples in a batch.
    FitSilhouettes,
    /// The hits at which the eikonal term is evaluated.
    EikonalHits,
    /// The points of the eikonal term in the ball.
    EikonalPoints,
    /// The directions of the eikonal term's offsets from the surface.
    OffsetDirections,
    /// The lengths of these offsets.
    OffsetLengths,
    /// Points at which the slope of a field is measured.
    Slopes,
    /// Points on a mesh.
    SurfacePoints,
    /// The initial parameters of a background.
    InitialBackground,
    /// The points of a ray whose opacity is summed.
    RayPoints,
    /// The colour behind the object of a view.
    BackgroundColor,
    /// The places of the points on a background's rays.
    BackgroundPoints,
    /// The pixels of a trial with refined cameras.
    CameraTrial,
    /// The points through which planes are tried.
    PlaneTrials,
    /// The planes that the search for depths tries.
    DepthPlanes,
    /// The points of a ray in front of a known depth.
    FreePoints,
    /// The points of the surface at which the bending term is evaluated.
    BendingHits,
    /// The directions of the bending term's steps.
    BendingDirections,
    /// A purpose outside dsdf, by a number of its own.
    Other(u32),
}

impl Purpose {
    /// All purposes but [`Purpose::Other`].
    pub const ALL: [Purpose; 33] = [
        Purpose::Replicate,
        Purpose::TargetImage,
        Purpose::TargetSamples,
        Purpose::PixelSamples,
        Purpose::EdgeSamples,
        Purpose::Lines,
        Purpose::AuxiliaryRays,
        Purpose::AuxiliaryShift,
        Purpose::WeightDirection,
        Purpose::InitialRadiance,
        Purpose::PixelOrder,
        Purpose::Permutation,
        Purpose::BackgroundPixel,
        Purpose::Iteration,
        Purpose::Part,
        Purpose::FitSamples,
        Purpose::FitSilhouettes,
        Purpose::EikonalHits,
        Purpose::EikonalPoints,
        Purpose::OffsetDirections,
        Purpose::OffsetLengths,
        Purpose::Slopes,
        Purpose::SurfacePoints,
        Purpose::InitialBackground,
        Purpose::RayPoints,
        Purpose::BackgroundColor,
        Purpose::BackgroundPoints,
        Purpose::CameraTrial,
        Purpose::PlaneTrials,
        Purpose::DepthPlanes,
        Purpose::FreePoints,
        Purpose::BendingHits,
        Purpose::BendingDirections,
    ];

    /// The number of the purpose; no two are equal.
    pub(crate) fn key(self) -> u64 {
        match self {
            Purpose::Replicate => 1,
            Purpose::TargetImage => 2,
            Purpose::TargetSamples => 3,
            Purpose::PixelSamples => 4,
            Purpose::EdgeSamples => 5,
            Purpose::Lines => 6,
            Purpose::AuxiliaryRays => 7,
            Purpose::AuxiliaryShift => 8,
            Purpose::WeightDirection => 9,
            Purpose::PixelOrder => 10,
            Purpose::Permutation => 11,
            Purpose::BackgroundPixel => 12,
            Purpose::Iteration => 13,
            Purpose::Part => 14,
            Purpose::FitSamples => 15,
            Purpose::FitSilhouettes => 16,
            Purpose::EikonalHits => 17,
            Purpose::EikonalPoints => 18,
            Purpose::OffsetDirections => 19,
            Purpose::OffsetLengths => 20,
            Purpose::SurfacePoints => 21,
            Purpose::Slopes => 23,
            Purpose::InitialRadiance => 22,
            Purpose::InitialBackground => 24,
            Purpose::RayPoints => 25,
            Purpose::BackgroundColor => 26,
            Purpose::BackgroundPoints => 27,
            Purpose::CameraTrial => 28,
            Purpose::PlaneTrials => 29,
            Purpose::DepthPlanes => 30,
            Purpose::FreePoints => 31,
            Purpose::BendingHits => 32,
            Purpose::BendingDirections => 33,
            Purpose::Other(number) => 1 << 32 | u64::from(number),
        }
    }
}
