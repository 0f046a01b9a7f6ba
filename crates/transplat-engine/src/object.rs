//! State of an object: its splat, the results of each stage, and their keys.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use glam::{Affine3A, Quat};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::scene::SceneBake;
use transplat_core::bake::surroundings::Detail;
use transplat_core::camera::CameraPose;
use transplat_core::derived::Derived;
use transplat_core::environment::Illumination;
use transplat_core::estimate::{Alignment, Estimate, FoundExposure};
use transplat_core::present::{LowConfidence, View};
use transplat_core::scene::{ESTIMATE, EnvironmentLight, Light, Transform};
use transplat_core::settings::optimizations::{Optimizations, SkippedWork};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::{SurfelFilter, UpAxis};
use transplat_core::transfer::{Part, PreparedTransfer, RelitRows, TransferCache};

use crate::bake::Baked;
use crate::environments::{Environment, Resolved};
use crate::splat::Splat;

/// Number of the next state.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// Inputs of a channel's colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ChannelKey {
    /// An object's bake, and that of the whole scene beside it.
    Visibility(Method, u64, Option<u64>),
    /// Material of the surfels: the version of the preparation.
    Materials(View, u64),
}

/// State of an object: its splat, and the results of each stage. Another splat begins with a new state.
#[derive(Default)]
pub struct ObjectState {
    /// Differs between all.
    pub id: u64,
    /// Splat, once it is loaded.
    pub asset: Option<Splat>,
    /// The file that the scene lists and that was to be it: being read, or not to be had.
    pub tried: Option<PathBuf>,
    /// True where the user has just put it into the scene: it goes again if its splat cannot be loaded.
    pub is_added: bool,
    /// Share of the others' radius from which it is put beside them, once its size is known.
    pub seeks_room: Option<f32>,
    /// A saved bake that the command line names.
    pub saved_bake: Option<PathBuf>,
    /// Capture light.
    pub source: Resolved,
    /// Source and target light as the object sees them.
    pub lights: Derived<LightsKey, [OrientedLight; 2]>,
    /// Visibility by method.
    pub bakes: HashMap<Method, Derived<BakeKey, Baked>>,
    /// Estimate of the capture light.
    pub estimate: Derived<bool, Estimate>,
    /// The light that is made of that, by its version and the up axis.
    pub estimated: Derived<(u64, UpAxis), Arc<Environment>>,
    /// True where an estimate was awaited when it was last looked for.
    pub estimate_awaited: bool,
    /// Errors of a user-set capture light at every rotation; none where the object says nothing.
    pub alignment: Derived<KnownLightKey, Option<Alignment>>,
    /// A user-set capture light whose clipped highlights are completed.
    pub completed: Derived<KnownLightKey, CompletedLight>,
    /// Cache of the preparation between settings.
    pub transfer: Arc<Mutex<TransferCache>>,
    /// Transfer from the source light.
    pub prepared: Derived<PrepareKey, Prepared>,
    /// Last relight that is shown.
    pub relit: Derived<RelitKey, Relighting>,
    /// Milliseconds of the last exact relight on the CPU.
    pub relit_in_ms: f64,
    /// Time at which the last coarse relight was shown.
    pub coarse_since: Option<Instant>,
    /// Surfels that are not drawn, `[n]` or empty: hidden, or too faint to be seen.
    pub hidden: Derived<HiddenKey, Arc<Vec<bool>>>,
    /// Surfels that the last relight left out.
    pub unseen: Unseen,
    /// Confidence in the relit colours.
    pub confidence: Derived<ShownKey, ConfidenceMap>,
    /// Relit colours of all parts, for a readout.
    pub readout: Derived<ShownKey, Arc<RelitRows>>,
    /// Version of the channel that is drawn.
    pub channel: Derived<ChannelKey, ()>,
}

impl ObjectState {
    /// Nothing is made of it yet.
    pub fn new(asset: Option<Splat>) -> Self {
        Self {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            asset,
            source: Resolved {
                light: Environment::assumed(),
                settings: EnvironmentLight::of(ESTIMATE),
            },
            ..Self::default()
        }
    }

    /// A copy with what is made of the object before it is relit, partial bakes among it.
    pub fn copy(&self) -> Self {
        let mut copy = Self {
            id: self.id,
            asset: self.asset.clone(),
            tried: self.tried.clone(),
            source: self.source.clone(),
            lights: self.lights.clone(),
            bakes: self.bakes.clone(),
            estimate: self.estimate.clone(),
            estimated: self.estimated.clone(),
            completed: self.completed.clone(),
            prepared: self.prepared.clone(),
            ..Self::default()
        };
        copy.prepared.drop_pending();
        copy.completed.drop_pending();
        for bake in copy.bakes.values_mut() {
            bake.drop_pending();
        }
        copy
    }

    /// The file that it is, or is to be.
    pub fn path(&self) -> Option<&Path> {
        let asset = self.asset.as_ref().map(|a| &a.path);
        asset.or(self.tried.as_ref()).map(PathBuf::as_path)
    }

    /// Share of a method's bake that is done, 0 to 1.
    pub fn bake_share(&self, method: Method) -> f32 {
        let bake = self.bakes.get(&method).and_then(Derived::current);
        bake.map_or(0.0, |b| b.share)
    }

    /// True where the relit colour that is shown is coarse.
    pub fn is_coarse(&self) -> bool {
        self.relit.made_from().is_some_and(|key| key.coarse)
    }

    /// Completed bakes, for another object of the same splat.
    pub fn kept_bakes(&self) -> HashMap<Method, Derived<BakeKey, Baked>> {
        let done = |bake: &Derived<BakeKey, Baked>| bake.current().is_some_and(|b| b.share == 1.0);
        let each = self.bakes.iter().filter(|(_, bake)| done(bake));
        each.map(|(method, bake)| (*method, bake.clone())).collect()
    }

    /// Bakes that are done, of any method.
    pub fn whole_bakes(&self) -> impl Iterator<Item = &Arc<Bake>> {
        let current = self.bakes.values().filter_map(Derived::current);
        current.filter(|b| b.share == 1.0).map(|b| &b.bake)
    }

    /// Completed bake of the directional method.
    pub fn whole_directional_bake(&self) -> Option<Arc<DirectionalBake>> {
        self.whole_bakes().find_map(|bake| match &**bake {
            Bake::Directional(bake) => Some(bake.clone()),
            Bake::Harmonic(_) | Bake::Scene(_) => None,
        })
    }

    /// From now on, a relight leaves out what is hidden now.
    pub fn leave_out_hidden(&mut self) {
        if let (Some(hidden), Some((hide, _))) = (self.hidden.get(), self.hidden.made_from())
            && !Arc::ptr_eq(&self.unseen.surfels, hidden)
        {
            self.unseen = Unseen {
                surfels: hidden.clone(),
                version: self.unseen.version + 1,
                has_hidden: !hide.is_off(),
            };
        }
    }
}

// ---- what the stages make, and what of ----

/// A light as the asset sees it; two are the same where nothing was changed in between.
#[derive(Clone)]
pub struct OrientedLight {
    /// Light in the object's coordinates.
    pub light: Arc<Illumination>,
}

impl PartialEq for OrientedLight {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.light, &other.light)
    }
}

/// Inputs of an object's lights: maps, settings, matching, placed lights, up axes of object and scene, the scene's capture light, and the object's place.
pub type LightsKey = (
    [u64; 2],
    [EnvironmentLight; 2],
    bool,
    Vec<Light>,
    [UpAxis; 2],
    (u64, EnvironmentLight),
    Transform,
);

/// All that is needed to know what objects see of each other: which, by state and version of its bake, and where each stands.
pub type InterObjectKey = Vec<(u64, u64, Affine3A)>;

/// Visibility between the objects that are shown, and its level of detail.
pub type InterObjectStage = Derived<(InterObjectKey, Detail), Arc<SceneBake>>;

/// Inputs of the visibility of objects that preset paper puts into a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct InsertionKey {
    /// Each by its state, the version of its own bake or 0 where that does not serve, and its place.
    pub each: Vec<(u64, u64, Transform)>,
    /// Directions of a bake.
    pub directions: usize,
    /// True where they throw shadows.
    pub shadows: bool,
}

/// All that their transfers depend on: what they see, by its version, which they are and what each was captured under, and the settings.
pub type InsertedKey = (u64, Vec<(u64, OrientedLight)>, TransferSettings);

/// All that a scene that is relit together depends on: preparations, surroundings, the light, the part, whether the whole is wanted beside
/// it, and what of the objects is not seen.
pub type JointKey = (Vec<u64>, u64, OrientedLight, (Part, bool), Vec<u64>);

/// Directions, and whether it is baked without the capture that it is cut out of. The fronts are the asset's: with others, what was baked is dropped.
pub type BakeKey = (usize, bool);

/// A user-set capture light whose clipped highlights are completed.
#[derive(Clone)]
pub struct CompletedLight {
    /// The light in the place of the file's.
    pub light: Arc<Environment>,
    /// All of its light over that of the file's, at the same exposure.
    pub gain: f32,
    /// Its exposure.
    pub exposure: FoundExposure,
}

/// All that a comparison of a user-set capture light with the object depends on: the light and the bake by their versions.
#[derive(Clone, PartialEq)]
pub struct KnownLightKey {
    /// Environment of the capture light.
    pub light: u64,
    /// Its settings, without those that change nothing in what is made.
    pub settings: EnvironmentLight,
    /// Version of the bake.
    pub bake: u64,
    /// Up axis of the object.
    pub up: UpAxis,
    /// True where the object alone is baked, of a capture.
    pub is_isolated: bool,
}

/// All that a preparation depends on: the bake by its version.
#[derive(Clone, PartialEq)]
pub struct PrepareKey {
    /// Version of the bake.
    pub bake: u64,
    /// Source light.
    pub source: OrientedLight,
    /// Method and terms.
    pub settings: TransferSettings,
}

/// A prepared transfer.
#[derive(Clone)]
pub struct Prepared {
    /// Transfer from the source light.
    pub prepared: PreparedTransfer,
    /// True where it relights on the GPU.
    pub on_gpu: bool,
    /// Work that it skips.
    pub skipped_work: Vec<SkippedWork>,
    /// Milliseconds that preparing took.
    pub ms: f64,
}

/// All that a relit asset depends on.
#[derive(Clone, PartialEq)]
pub struct RelitKey {
    /// Version of the preparation.
    pub prepared: u64,
    /// Target light.
    pub target: OrientedLight,
    /// Part of the relit colour.
    pub part: Part,
    /// Set of surfels that may be left out, as a number that grows when one becomes visible again.
    pub unseen: u64,
    /// Version of what it sees of others, 0 where it is alone.
    pub surroundings: u64,
    /// True for a preview while the light changes.
    pub coarse: bool,
}

/// All that a whole relit asset depends on: a part of one is no other.
pub type ShownKey = (u64, OrientedLight, u64);

impl RelitKey {
    /// Relight of all parts that this is a part of.
    pub fn shown(&self) -> ShownKey {
        (self.prepared, self.target.clone(), self.surroundings)
    }
}

/// Figures of a relight.
pub struct Relighting {
    /// Milliseconds on the CPU; the GPU's own are in its timer.
    pub cpu_ms: Option<f64>,
    /// Stops of the target's mean irradiance over the source's, where both are what the settings name.
    pub stops_over_source: Option<f32>,
}

/// All that this depends on.
pub type HiddenKey = (SurfelFilter, Optimizations);

/// Surfels that the last relight left out.
#[derive(Default)]
pub struct Unseen {
    /// True for each surfel that is left out, `[n]` or empty.
    pub surfels: Arc<Vec<bool>>,
    /// Another one for each set of them.
    pub version: u64,
    /// True where any of them is hidden by the user and may be shown again.
    pub has_hidden: bool,
}

/// Confidence in the relit colours.
pub struct ConfidenceMap {
    /// `[n]`
    pub of: Vec<Option<LowConfidence>>,
    /// Shares of all, `[LowConfidence::ALL]`.
    pub shares: [f32; LowConfidence::ALL.len()],
}

/// Camera and objects that lights are fixed to, as they were last seen.
#[derive(Clone, PartialEq)]
pub struct Followed {
    /// Pose of the camera.
    pub camera: CameraPose,
    /// Up axis of the scene.
    pub up: UpAxis,
    /// The objects' states, and where they stand.
    pub places: Vec<(u64, Transform)>,
}

/// All that a ground's bake depends on: directions, up axis, and what stands where.
pub type GroundKey = (usize, UpAxis, Vec<(u64, Affine3A)>);

/// All that its light depends on: the bake by its version, and the lights as the first object sees them, as it is turned.
pub type GroundLitKey = (u64, [OrientedLight; 2], Quat);
