//! Objects put into a scene as the paper does it (section 4.2): each is relit by the light that the scene's splat shows at its place, and for the
//! shadow on the scene the surfels around it count as its own.
//!
//! Nothing shines back on the scene, and what is not near casts no shadow: that is what it leaves out.

use std::sync::Arc;

use glam::{DMat3, Vec3};

use crate::bake::harmonic::HarmonicBake;
use crate::bake::insertion::InsertionBake;
use crate::camera::{Camera, NEAR};
use crate::color::Display;
use crate::environment::{Illumination, project_environment};
use crate::error::Result;
use crate::probe::{Beyond, Cube, RadianceToward};
use crate::rasterize::{ColorSpace, rasterize, shade};
use crate::settings::TransferSettings;
use crate::settings::optimizations::SkippedWork;
use crate::sh::{coefficient_count, evaluate_sh};
use crate::surfels::SurfelCloud;
use crate::transfer::harmonic::HarmonicTransfer;
use crate::transfer::materials::Materials;
use crate::transfer::relit::{Part, Relight, Relit};

/// Rows of the map in which the light at an object is taken: far more than SH series hold.
const PROBE_ROWS: usize = 64;

/// A scene and the objects in it, each under the light of its own capture, ready for any other. Everything is in the scene's coordinates; the
/// surfels are numbered object after object.
#[derive(Clone, Debug)]
pub struct HarmonicScene {
    /// Visibility of the objects.
    pub bake: Arc<InsertionBake>,
    /// The scene, and then what is put into it.
    objects: Vec<Arc<HarmonicTransfer>>,
    /// The scene's surfels around each object that throws a shadow, without it and with it.
    shadows: Vec<[HarmonicTransfer; 2]>,
    firsts: Vec<usize>,
}

impl HarmonicScene {
    /// Takes the light of each object's capture, as the object has it.
    ///
    /// # Errors
    /// A setting is out of range.
    pub fn new(
        bake: Arc<InsertionBake>,
        sources: &[&Illumination],
        settings: &TransferSettings,
    ) -> Result<Self> {
        let prepare = |cloud: &SurfelCloud, bake: &HarmonicBake, light: &Illumination| {
            let light = light.radiance.truncated(settings.sh_degree);
            HarmonicTransfer::new(cloud, bake, &light, settings)
        };
        let placed = bake.objects.iter().zip(sources);
        let sources: Vec<Illumination> = placed
            .map(|(o, source)| source.rotated(DMat3::from_quat(o.turn.as_dquat())))
            .collect();
        let each = bake.objects.iter().zip(&sources);
        let objects = each
            .map(|(o, source)| Ok(Arc::new(prepare(&o.cloud, &o.bake, source)?)))
            .collect::<Result<_>>()?;
        let shadows = bake.shadows.iter().map(|(_, shadow)| {
            let without = prepare(&shadow.around, &shadow.without, &sources[0])?;
            let with = without.shadowed_as(&shadow.with);
            Ok([without, with])
        });
        let shadows = shadows.collect::<Result<_>>()?;
        let mut firsts = vec![0];
        for object in &bake.objects {
            firsts.push(firsts[firsts.len() - 1] + object.cloud.len());
        }
        Ok(Self {
            objects,
            shadows,
            firsts,
            bake,
        })
    }

    /// Relights; each object's result is in the scene's coordinates.
    fn relight_placed(&self, target: &Illumination, part: Part) -> Result<Vec<Relit>> {
        let middle = self.bake.objects[0].cloud.bounds().center;
        let target = &*target.at_one_place(middle);
        let mut scene = self.objects[0].relight_seen(target, part, &[])?;
        let unshaded = self.objects[0].relight_seen(target, Part::Whole, &[])?;
        let mut all = Vec::new();
        for (object, placed) in self.objects.iter().zip(&self.bake.objects).skip(1) {
            let light = self.light_at(placed.cloud.bounds().center, &unshaded, target);
            all.push(object.relight_seen(&light, part, &[])?);
        }
        let k = coefficient_count(scene.degree);
        for ((_, shadow), transfers) in self.bake.shadows.iter().zip(&self.shadows) {
            let [without, with] = transfers.each_ref().map(|t| t.tau(target));
            let (without, with) = (without?, with?);
            for ((i, share), (without, with)) in shadow.near.iter().zip(without.iter().zip(with)) {
                let kept: [f32; 3] = std::array::from_fn(|c| {
                    let ratio = if without[c] > 0.0 {
                        (with[c] / without[c]).clamp(0.0, 1.0)
                    } else {
                        1.0
                    };
                    1.0 + share * (ratio - 1.0)
                });
                let multiply = |v: &mut [f32; 3]| *v = std::array::from_fn(|c| v[c] * kept[c]);
                scene.sh[i * k..][..k].iter_mut().for_each(multiply);
                multiply(&mut scene.tau[*i]);
            }
        }
        all.insert(0, scene);
        Ok(all)
    }

    /// The first of several objects as it is where the others are not, in the scene's coordinates.
    pub fn first_alone(&self) -> Option<Arc<HarmonicTransfer>> {
        (self.objects.len() > 1).then(|| self.objects[0].clone())
    }

    /// The light at a place: the scene as it is relit, and the target where it is open.
    fn light_at(&self, place: Vec3, scene: &Relit, target: &Illumination) -> Illumination {
        let cloud = &self.bake.objects[0].cloud;
        let draw = |camera: &Camera| {
            let space = ColorSpace::Display(Display::default());
            let (sh, degree) = (&scene.sh, scene.degree);
            let colors = shade(
                &cloud.positions,
                sh,
                degree,
                scene.encoding,
                camera.eye,
                space,
            );
            Ok::<_, std::convert::Infallible>(rasterize(cloud, camera, &colors, &[]))
        };
        let radii = self.bake.shadows.iter().map(|(_, s)| s.ball.radius);
        let near = NEAR * radii.fold(cloud.bounds().radius, f32::min);
        let Ok(cube) = Cube::seen_from(place, near, PROBE_ROWS, draw);
        let (series, degree) = (&target.radiance.coefficients, target.radiance.degree);
        let sky = |d: Vec3| evaluate_sh(series, degree, d.to_array()).map(|v| v.max(0.0));
        let beyond = Beyond {
            environment: Some(&sky as RadianceToward<'_>),
            ..Beyond::default()
        };
        // In the scene's coordinates, as all of it is.
        let probe = cube.light(PROBE_ROWS, Default::default(), beyond);
        Illumination::new(project_environment(&probe.map, degree), None)
    }

    fn of_surfel<T>(&self, i: usize, of: impl Fn(&HarmonicTransfer, usize) -> T) -> T {
        let object = self.firsts.partition_point(|first| *first <= i) - 1;
        of(&self.objects[object], i - self.firsts[object])
    }
}

impl Relight for HarmonicScene {
    fn relight_objects(&self, target: &Illumination, part: Part, _: &[bool]) -> Result<Vec<Relit>> {
        let placed = self.relight_placed(target, part)?;
        let each = placed.into_iter().zip(&self.bake.objects);
        Ok(each
            .map(|(relit, o)| relit.turned(o.turn.inverse()))
            .collect())
    }

    fn relight_after(
        &self,
        last: Option<Relit>,
        target: &Illumination,
        part: Part,
        _: &[bool],
    ) -> Result<Relit> {
        // Two at once would be twice the memory.
        drop(last);
        let each = self.relight_placed(target, part)?;
        let degree = each.iter().map(|r| r.degree).max().unwrap_or_default();
        let each = each.into_iter().map(|r| r.of_degree(degree));
        Ok(Relit::together(each).expect("at least one object"))
    }

    fn computed_part(&self, shown: Part) -> Part {
        shown
    }

    fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        Ok(self.relight_seen(target, Part::Whole, &[])?.tau)
    }

    fn materials(&self, whitest: Option<f32>) -> Materials {
        // They are prepared where they stand.
        Materials::together(self.objects.iter().map(|o| o.materials(whitest)))
    }

    fn skipped_work(&self, cloud: &SurfelCloud) -> Vec<SkippedWork> {
        self.objects[0].skipped_work(cloud)
    }

    fn skipped_work_for(&self, light: &Illumination, on_gpu: bool) -> Option<SkippedWork> {
        self.objects[0].skipped_work_for(light, on_gpu)
    }

    /// The scene's.
    fn light_gain(&self) -> f32 {
        self.objects[0].light_gain
    }

    fn source_was_black(&self) -> bool {
        self.objects.iter().any(|o| o.source_was_black)
    }

    fn bytes(&self) -> usize {
        self.objects.iter().map(|o| o.bytes()).sum()
    }

    fn epsilon_share(&self, i: usize) -> f32 {
        self.of_surfel(i, HarmonicTransfer::epsilon_share)
    }

    fn amplification(&self, i: usize) -> f32 {
        self.of_surfel(i, HarmonicTransfer::amplification)
    }

    fn is_dark(&self, i: usize) -> bool {
        self.of_surfel(i, HarmonicTransfer::is_dark)
    }

    fn dark_share(&self) -> f32 {
        let surfels = self.firsts[self.objects.len()];
        let dark = (0..surfels).filter(|i| self.is_dark(*i)).count();
        dark as f32 / surfels.max(1) as f32
    }
}
