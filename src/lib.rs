//! Parallel wavelet radiosity: the inter-reflection of light in diffuse scenes, to a stated error.
//!
//! The equation solved is `B(x) = M(x) + ρ(x) ∫ K(x,y) B(y) dy` with `K = cosθ cosθ' V / (π r²)`, equation 1 of
//! Cavin, Alonso, Paul, *Parallel Wavelet Radiosity* (1998). The rooms, each importing only the ones above it:
//!
//! | room | what lives there |
//! |---|---|
//! | [`math`] | multiwavelet bases and two-scale relations, quadrature, planar polygons |
//! | [`scene`] | surfaces, materials, lights; readers of scene files; validation |
//! | [`visibility`] | is the segment between two points blocked? which polygons could block it? |
//! | [`transport`] | the kernel `K`, Lambert's closed form, emission packets, the light of emitters on one receiver |
//! | [`radiosity`] | elements, push-pull, the state of a solution and its error |
//! | [`schedule`] | which pair is computed when, and by whom |
//! | [`study`] | runs over threads and schedules, and replays of recorded runs on other machines |
//! | [`output`] | meshes, images, reports |
//! | [`cli`] | arguments → validated plan → commands |
#![forbid(unsafe_code)]

pub mod cli;
pub mod math;
pub mod output;
pub mod radiosity;
pub mod scene;
pub mod schedule;
pub mod study;
pub mod transport;
pub mod visibility;
