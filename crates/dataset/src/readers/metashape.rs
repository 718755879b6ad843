//! Camera files of Agisoft Metashape (menu Export Cameras, `.xml`) with the images beside them, in
//! `images/` or in `input/`. The lens model is that of the "Agisoft Metashape User Manual",
//! appendix "Camera models".
//!
//! A camera's transform is camera-to-chunk, by rows, with axes x right, y down, z forward. That of
//! its component (or of the chunk, in older files) leads to the world: a rotation, a scale and a
//! translation. The principal point is relative to the image's centre. Cameras without a transform
//! are not aligned, and are left out.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DMat4, DVec2, DVec3};
use roxmltree::{Document, Node};

use crate::readers::images::reduced_copies;
use crate::readers::lens::Lens;
use crate::readers::lookup::{FOLDERS, image_named};
use crate::readers::projection::{camera_to_world, is_none, placed};
use crate::readers::recognised::{Recognised, Views};
use crate::readers::result::Result;
use crate::readers::unread::UnreadView;
use files::InputError;
use render::Camera;

/// The start of a file in which its first element is looked for, in bytes.
const START: usize = 4096;

/// Bytes of memory for each byte of a file: the shortest element has four bytes.
const MEMORY_PER_BYTE: u64 = 40;

/// Whether a file is a camera file of Metashape, by its start.
pub(crate) fn is_camera_file(path: &Path) -> bool {
    let is_xml = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("xml"));
    let Some((file, _)) = is_xml.then(|| files::open(path, "file", "XML").ok()).flatten() else {
        return false;
    };
    let mut start = Vec::new();
    let taken = std::io::Read::take(file, START as u64);
    let read = std::io::Read::read_to_end(&mut { taken }, &mut start);
    let text = String::from_utf8_lossy(&start);
    read.is_ok() && text.contains("<document") && text.contains("<chunk")
}

/// Reads the chunk with the most aligned cameras.
pub(crate) fn read(folder: &Path, file: &Path) -> Result<Recognised> {
    let text = files::read_text(file, "file", "an XML file")?;
    let length = text.len() as u64;
    files::check_memory(file, "file", format!("{length} bytes"), length * MEMORY_PER_BYTE)?;
    let document = Document::parse(&text)
        .map_err(|e| InputError::new(file, "file", e, "XML of Metashape (menu Export Cameras)"))?;
    let chunks = children(document.root_element(), "chunk");
    let mut best: Option<Chunk<'_, '_>> = None;
    for chunk in chunks.map(|node| Chunk::new(file, node)) {
        let chunk = chunk?;
        if best.as_ref().is_none_or(|best| chunk.cameras.len() > best.cameras.len()) {
            best = Some(chunk);
        }
    }
    let chunk = best.ok_or_else(|| {
        let found = format!("a document <{}> without", document.root_element().tag_name().name());
        InputError::new(file, "chunk", found, "cameras exported by Metashape")
    })?;
    chunk.read(folder)
}

fn children<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.has_tag_name(name))
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

/// `N` finite numbers of an element; `place` names it in messages.
fn numbers<const N: usize>(file: &Path, place: &str, node: Node<'_, '_>) -> Result<[f64; N]> {
    let text = node.text().unwrap_or_default();
    let all: Option<Vec<f64>> =
        text.split_whitespace().map(|w| w.parse().ok().filter(|v: &f64| v.is_finite())).collect();
    all.and_then(|all| all.try_into().ok()).ok_or_else(|| {
        let expected = format!("{N} finite numbers");
        InputError::new(file, place, format!("{:?}", text.trim()), expected)
    })
}

/// The 16 numbers of a pose, which may be none: not finite.
fn entries(file: &Path, place: &str, node: Node<'_, '_>) -> Result<[f64; 16]> {
    let text = node.text().unwrap_or_default();
    let all: Option<Vec<f64>> = text.split_whitespace().map(|w| w.parse().ok()).collect();
    all.and_then(|all| all.try_into().ok()).ok_or_else(|| {
        InputError::new(file, place, format!("{:?}", text.trim()), "16 finite numbers")
    })
}

/// The sensor of this number.
fn sensor<'a, 'i>(chunk: Node<'a, 'i>, id: &str) -> Option<Node<'a, 'i>> {
    let all = child(chunk, "sensors")?;
    children(all, "sensor").find(|node| node.attribute("id").unwrap_or_default() == id)
}

/// The calibration of a sensor: the adjusted one if there are several.
fn calibration<'a, 'i>(sensor: Node<'a, 'i>) -> Option<Node<'a, 'i>> {
    let is_adjusted = |node: &Node<'_, '_>| node.attribute("class") == Some("adjusted");
    let adjusted = children(sensor, "calibration").find(is_adjusted);
    adjusted.or_else(|| child(sensor, "calibration"))
}

/// The camera model of a sensor.
fn model<'a>(sensor: Node<'a, '_>) -> &'a str {
    let of_calibration = calibration(sensor).and_then(|node| node.attribute("type"));
    of_calibration.or(sensor.attribute("type")).unwrap_or("frame")
}

/// Whether a camera has a sensor that sees in all directions.
fn is_spherical(chunk: Node<'_, '_>, camera: Node<'_, '_>) -> bool {
    let sensor = sensor(chunk, camera.attribute("sensor_id").unwrap_or_default());
    sensor.is_some_and(|sensor| ["spherical", "cylindrical"].contains(&model(sensor)))
}

/// The numbers of cameras that are left out, by the reason.
#[derive(Default)]
struct LeftOut {
    unaligned: usize,
    unnamed: usize,
    spherical: usize,
}

impl LeftOut {
    fn notes(&self) -> Vec<String> {
        let all = [
            ("cameras that Metashape did not align, left out", self.unaligned),
            ("cameras without a label, so without a photograph, left out", self.unnamed),
            (
                "cameras of spherical or cylindrical sensors, which are no pinholes, left out",
                self.spherical,
            ),
        ];
        let some = all.into_iter().filter(|(_, count)| *count > 0);
        some.map(|(text, count)| format!("{text}: {count}")).collect()
    }
}

/// A similarity transform: x ↦ rotation · x · scale + translation.
#[derive(Clone, Copy)]
struct Similarity {
    rotation: DMat3,
    scale: f64,
    translation: DVec3,
}

impl Similarity {
    const IDENTITY: Similarity =
        Similarity { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };

    /// The `transform` of a chunk or of a component; parts that are missing change nothing.
    fn of(file: &Path, place: &str, node: Node<'_, '_>) -> Result<Self> {
        let mut found = Similarity::IDENTITY;
        let Some(transform) = child(node, "transform") else { return Ok(found) };
        let place = |part: &str| format!("{place}/transform/{part}");
        if let Some(node) = child(transform, "rotation") {
            let rows = numbers::<9>(file, &place("rotation"), node)?;
            found.rotation = DMat3::from_cols_array(&rows).transpose();
        }
        if let Some(node) = child(transform, "translation") {
            found.translation = numbers::<3>(file, &place("translation"), node)?.into();
        }
        if let Some(node) = child(transform, "scale") {
            [found.scale] = numbers(file, &place("scale"), node)?;
            if found.scale <= 0.0 {
                let expected = "a scale above 0";
                return Err(InputError::new(file, place("scale"), found.scale, expected));
            }
        }
        Ok(found)
    }

    /// This after `first`.
    fn after(&self, first: &Similarity) -> Self {
        Similarity {
            rotation: self.rotation * first.rotation,
            scale: self.scale * first.scale,
            translation: self.point(first.translation),
        }
    }

    fn point(&self, point: DVec3) -> DVec3 {
        self.rotation * point * self.scale + self.translation
    }
}

/// A chunk, and its aligned cameras of the component with the most.
struct Chunk<'a, 'i> {
    file: &'a Path,
    node: Node<'a, 'i>,
    cameras: Vec<Node<'a, 'i>>,
    /// All cameras by their numbers: one of a rig has its pose relative to its master.
    masters: BTreeMap<&'a str, Node<'a, 'i>>,
    /// From the component to the world.
    to_world: Similarity,
    notes: Vec<String>,
}

impl<'a, 'i> Chunk<'a, 'i> {
    fn new(file: &'a Path, node: Node<'a, 'i>) -> Result<Self> {
        let all = child(node, "cameras").into_iter().flat_map(|all| all.descendants());
        // A disabled camera is not used in Metashape either.
        let is_enabled =
            |camera: &Node<'_, '_>| !matches!(camera.attribute("enabled"), Some("0" | "false"));
        let all = all.filter(|n| n.has_tag_name("camera")).filter(is_enabled);
        let mut rest = LeftOut::default();
        let mut parts: BTreeMap<Option<&str>, Vec<Node<'a, 'i>>> = BTreeMap::new();
        let of_id = all.clone().filter_map(|camera| Some((camera.attribute("id")?, camera)));
        let masters: BTreeMap<&str, Node<'a, 'i>> = of_id.collect();
        for camera in all {
            let master =
                camera.attribute("master_id").filter(|id| camera.attribute("id") != Some(id));
            let master = master.and_then(|id| masters.get(id)).copied();
            let is_placed = child(master.unwrap_or(camera), "transform").is_some();
            let is_named = camera.attribute("label").is_some_and(|label| !label.is_empty());
            match (is_placed, is_named, is_spherical(node, camera)) {
                (false, ..) => rest.unaligned += 1,
                (_, false, _) => rest.unnamed += 1,
                (.., true) => rest.spherical += 1,
                _ => {
                    let component = master.unwrap_or(camera).attribute("component_id");
                    parts.entry(component).or_default().push(camera);
                }
            }
        }
        let mut notes = rest.notes();
        let count = parts.len();
        let largest = parts.into_iter().rev().max_by_key(|(_, cameras)| cameras.len());
        let (component, cameras) = largest.unwrap_or_default();
        if count > 1 {
            let text = "components that Metashape could not connect: the largest is read";
            notes.push(format!("{count} {text}"));
        }
        let of_chunk = Similarity::of(file, "chunk", node)?;
        let components = child(node, "components").into_iter();
        let mut components = components.flat_map(|all| children(all, "component"));
        let to_world = match components.find(|node| node.attribute("id") == component) {
            Some(node) => of_chunk.after(&Similarity::of(file, "component", node)?),
            None => of_chunk,
        };
        Ok(Chunk { file, node, cameras, masters, to_world, notes })
    }

    fn error(&self, place: &str, found: &str, expected: &str) -> InputError {
        InputError::new(self.file, place, found, expected)
    }

    fn read(mut self, folder: &Path) -> Result<Recognised> {
        if self.cameras.is_empty() {
            let found = format!(
                "none with a transform{}",
                self.notes.iter().map(|n| format!("; {n}")).collect::<String>()
            );
            return Err(self.error(
                "cameras",
                &found,
                "aligned cameras of a frame or fisheye lens",
            ));
        }
        let mut sensors = BTreeMap::new();
        let mut views = Views::default();
        for camera in &self.cameras {
            let label = camera.attribute("label").unwrap_or_default();
            let id = camera.attribute("sensor_id").unwrap_or_default();
            if !sensors.contains_key(id) {
                sensors.insert(id, self.sensor(id)?);
            }
            let pose = self.pose(label, *camera)?;
            let (path, is_reduced) = image_of(folder, label);
            views.add(path, |path| {
                let (Camera { width, height, focal, principal, .. }, lens) = sensors[id];
                let wrong = |found: String| {
                    let place = format!("camera {label:?} transform");
                    self.error(&place, &found, "a rotation and a translation")
                };
                let placed = placed([width, height], focal, principal, pose, wrong)?;
                let Some((camera, scale)) = placed else { return Ok(None) };
                let view = UnreadView::of_image(label.to_owned(), path, camera, lens);
                let view = view.with_pose_scale(scale);
                let view = UnreadView { size_source: Some(format!("sensor {id}")), ..view };
                Ok(Some(if is_reduced { view.of_reduced_image()? } else { view }))
            })?;
        }
        let format = "Metashape camera file: camera-to-chunk, OpenCV axes";
        let notes = std::mem::take(&mut self.notes);
        Ok(Recognised { notes, ..Recognised::new(format, views) })
    }

    /// The camera-to-world matrix of a camera.
    fn pose(&self, label: &str, camera: Node<'_, '_>) -> Result<DMat4> {
        let master = camera.attribute("master_id").filter(|id| camera.attribute("id") != Some(id));
        let m = match master.and_then(|id| self.masters.get(id)) {
            Some(master) => self.transform(label, *master)? * self.in_rig(label, camera)?,
            None => self.transform(label, camera)?,
        };
        let axes = self.to_world.rotation * DMat3::from_mat4(m);
        let eye = self.to_world.point(m.w_axis.truncate());
        Ok(camera_to_world(axes.x_axis, axes.y_axis, axes.z_axis, eye))
    }

    /// The transform of a camera.
    fn transform(&self, label: &str, camera: Node<'_, '_>) -> Result<DMat4> {
        let place = format!("camera {label:?} transform");
        let Some(transform) = child(camera, "transform") else {
            return Err(self.error(&place, "nothing", "16 numbers"));
        };
        let m = DMat4::from_cols_array(&entries(self.file, &place, transform)?).transpose();
        if !is_none(m) && m.row(3).to_array() != [0.0, 0.0, 0.0, 1.0] {
            let found = format!("last row {}", m.row(3));
            return Err(self.error(&place, &found, "last row [0, 0, 0, 1]"));
        }
        Ok(m)
    }

    /// The pose of a camera of a rig relative to its master: its own transform, or else the
    /// rotation and the translation of its sensor.
    fn in_rig(&self, label: &str, camera: Node<'_, '_>) -> Result<DMat4> {
        if child(camera, "transform").is_some() {
            return self.transform(label, camera);
        }
        let place = format!("camera {label:?} sensor");
        let sensor = sensor(self.node, camera.attribute("sensor_id").unwrap_or_default());
        let part = |name| sensor.and_then(|sensor| child(sensor, name));
        let (Some(rotation), Some(translation)) = (part("rotation"), part("translation")) else {
            let expected =
                "a transform of the camera, or a rotation and a translation of its sensor";
            return Err(self.error(&place, "neither", expected));
        };
        let rows = numbers::<9>(self.file, &place, rotation)?;
        let axes = DMat3::from_cols_array(&rows).transpose();
        let eye = DVec3::from(numbers::<3>(self.file, &place, translation)?);
        Ok(DMat4::from_translation(eye) * DMat4::from_mat3(axes))
    }

    /// The camera at the origin and the lens of a sensor.
    fn sensor(&self, id: &str) -> Result<(Camera, Lens)> {
        let place = format!("sensor {id}");
        let sensor = sensor(self.node, id)
            .ok_or_else(|| self.error(&place, "no such sensor", "that of a camera"))?;
        let calibration = calibration(sensor)
            .ok_or_else(|| self.error(&place, "no calibration", "the calibration of a camera"))?;
        let model = model(sensor);
        let size = child(calibration, "resolution").or_else(|| child(sensor, "resolution"));
        let (width, height) = self.size(&place, size)?;
        let get = |key: &'static str| match child(calibration, key) {
            Some(node) => numbers(self.file, &format!("{place} {key}"), node).map(|[v]| v),
            None => Ok(0.0),
        };
        let f = get("f")?;
        let focal = DVec2::new(f + get("b1")?, f);
        if focal.min_element() <= 0.0 {
            let found = format!("focal lengths {}, {}", focal.x, focal.y);
            return Err(self.error(&format!("{place} f"), &found, "focal lengths above 0"));
        }
        let half = DVec2::new(f64::from(width), f64::from(height)) / 2.0;
        let principal = half + DVec2::new(get("cx")?, get("cy")?);
        for key in ["p3", "p4"] {
            let value = get(key)?;
            if value != 0.0 {
                let (place, found) = (format!("{place} {key}"), value.to_string());
                return Err(self.error(&place, &found, "0: only p1 and p2 are modelled"));
            }
        }
        let k = [get("k1")?, get("k2")?, get("k3")?, get("k4")?];
        let lens = match model {
            "frame" => Lens::radial(k),
            "fisheye" | "equidistant_fisheye" => Lens::fisheye(k),
            other => return Err(self.error(&place, other, "the type frame or fisheye")),
        };
        // Metashape's p1 is OpenCV's p2, and the other way round.
        let lens = Lens { tangential: [get("p2")?, get("p1")?], skew: get("b2")?, ..lens };
        let (eye, right, up, forward) = (DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Z);
        let radial = DVec2::ZERO;
        Ok((Camera { width, height, focal, principal, eye, right, up, forward, radial }, lens))
    }

    /// Width and height in pixels of an element `resolution`.
    fn size(&self, place: &str, node: Option<Node<'_, '_>>) -> Result<(u32, u32)> {
        let side = |key: &str| {
            let text = node.and_then(|node| node.attribute(key)).unwrap_or("nothing");
            text.parse().ok().filter(|n| (1..=1 << 16).contains(n)).ok_or_else(|| {
                let expected = "a whole number of pixels from 1 to 65536";
                self.error(&format!("{place} resolution {key}"), text, expected)
            })
        };
        Ok((side("width")?, side("height")?))
    }
}

/// The image of a label, and whether it is a reduced copy: in `images/`, in `input/`, beside the
/// camera file, or in a copy of these. A label may have the extension or not.
fn image_of(folder: &Path, label: &str) -> (PathBuf, bool) {
    let full = FOLDERS.map(|name| folder.join(name));
    let beside = full.iter().chain([folder].map(PathBuf::from).iter()).cloned().collect::<Vec<_>>();
    let mut places = beside.iter().filter_map(|place| image_named(place, label));
    if let Some(path) = places.next() {
        return (path, false);
    }
    let copies = full.iter().filter(|folder| !folder.exists()).flat_map(|f| reduced_copies(f));
    let reduced = copies.into_iter().find_map(|copy| image_named(&copy, label));
    reduced.map_or((full[0].join(label), false), |path| (path, true))
}
