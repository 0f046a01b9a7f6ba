//! Stage *transfer* on the GPU. CPU twin: [`transplat_core::transfer`].

pub mod directional;
pub mod harmonic;

use std::sync::{Arc, OnceLock};

use transplat_core::color::Encoding;
use transplat_core::environment::Illumination;
use transplat_core::transfer::{Part, PreparedTransfer, Relit, RelitRows};

use crate::context::{Context, GpuError, Result};
use crate::rasterize::{ResidentPaint, ResidentSh, ResidentVectors};
use directional::GpuDirectional;
use harmonic::GpuHarmonic;

/// A prepared transfer on the GPU, whatever the method; made on any thread.
pub struct GpuTransfer {
    context: Arc<Context>,
    by: By,
    relit: ResidentSh,
    /// Part of the colour that was requested last.
    part: Part,
}

enum By {
    /// With the asset's DC in linear light, once that is to be seen.
    Harmonic(Box<GpuHarmonic>, OnceLock<ResidentVectors>),
    /// With the ratio of the last result.
    Directional(Box<GpuDirectional>, ResidentVectors),
}

impl GpuTransfer {
    /// Uploads a prepared transfer.
    ///
    /// # Errors
    /// It is too large for the adapter, of several objects, or the driver failed.
    pub fn new(context: &Arc<Context>, prepared: &PreparedTransfer) -> Result<Self> {
        let (relit, by) = match prepared {
            PreparedTransfer::Harmonic(harmonic) => {
                let transfer = Box::new(GpuHarmonic::new(context, harmonic)?);
                let relit = ResidentSh {
                    chunks: transfer.relit(),
                    degree: harmonic.asset_degree,
                    encoding: Encoding::Linear,
                };
                (relit, By::Harmonic(transfer, OnceLock::new()))
            }
            PreparedTransfer::Directional(directional) => {
                let transfer = Box::new(GpuDirectional::new(context, directional)?);
                let relit = ResidentSh {
                    chunks: transfer.relit(),
                    degree: directional.asset.nodes.degree,
                    encoding: directional.asset.encoding,
                };
                let tau = ResidentVectors(transfer.tau());
                (relit, By::Directional(transfer, tau))
            }
            PreparedTransfer::Scene(_) | PreparedTransfer::HarmonicScene(_) => {
                return Err(GpuError::OnCpu("several objects are relit"));
            }
        };
        Ok(Self {
            context: context.clone(),
            by,
            relit,
            part: Part::Whole,
        })
    }

    /// Makes what a light needs that no other did, and what shows its ratio, so that nothing has to be made when it comes.
    pub fn warm_up(&self, target: &Illumination) {
        let has_suns = target
            .light_samples
            .as_ref()
            .is_some_and(|b| !b.suns.is_empty());
        match &self.by {
            By::Directional(transfer, _) if has_suns => transfer.prepare_suns(),
            By::Directional(..) => {}
            By::Harmonic(..) => drop(self.ratio_paint()),
        }
    }

    /// Begins to relight by another light; `part` says what of the colour is wanted, and what of surfels that nobody sees (`[n]` or empty) is
    /// not said. The harmonic method has all parts in one result, in bands of their own; the directional one makes the part that is wanted.
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn submit(
        &mut self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> transplat_core::Result<()> {
        match &self.by {
            By::Harmonic(transfer, _) => {
                let prepared = &transfer.prepared;
                let target = target.at_one_place(prepared.center);
                transfer.submit(&prepared.light(&target.radiance));
            }
            // Their rays differ from surfel to surfel: the CPU traces them.
            By::Directional(transfer, _) if !target.emitters.is_empty() => {
                let light = transfer.prepared.light(target)?;
                // What is read back is exported: as exact as it is computed.
                let relit = transfer.prepared.relight(light, part, unseen);
                transfer.write(&relit.sh, &relit.tau);
            }
            By::Directional(transfer, _) => {
                let light = transfer.prepared.light(target)?;
                transfer.set_unseen(unseen);
                transfer.submit(&light, part);
            }
        }
        self.part = part;
        Ok(())
    }

    /// Takes what was relit elsewhere, by the directional method; `part` is what it has.
    pub fn take(&mut self, relit: &RelitRows, part: Part) {
        if let By::Directional(transfer, _) = &self.by {
            transfer.write(&relit.sh.values(), &relit.tau);
            self.part = part;
        }
    }

    /// Waits until what was submitted is done.
    ///
    /// # Errors
    /// The driver failed.
    pub fn finish(&self) -> Result<()> {
        self.context.wait()
    }

    /// The last result.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read(&self) -> Result<Relit> {
        Ok(match &self.by {
            By::Harmonic(transfer, _) => transfer.prepared.relit(transfer.read()?, self.part),
            By::Directional(transfer, _) => transfer.read()?,
        })
    }

    /// The last result where it lies.
    pub(crate) fn resident(&self) -> &ResidentSh {
        &self.relit
    }

    /// A part of the last result as a colour.
    pub(crate) fn paint(&self, part: Part) -> ResidentPaint<'_> {
        let part = match self.by {
            By::Harmonic(..) => part,
            By::Directional(..) => Part::Whole,
        };
        ResidentPaint::Sh(&self.relit, part)
    }

    /// The transfer ratio of the last result as a colour.
    pub(crate) fn ratio_paint(&self) -> ResidentPaint<'_> {
        match &self.by {
            By::Harmonic(transfer, source_dc) => {
                let upload = || {
                    let dc = transfer.prepared.dc.iter().map(|&[r, g, b]| [r, g, b, 0.0]);
                    ResidentVectors::upload(&self.context, &dc.collect::<Vec<_>>())
                };
                ResidentPaint::Tau(&self.relit, source_dc.get_or_init(upload))
            }
            By::Directional(_, tau) => ResidentPaint::Ratio(tau),
        }
    }
}
