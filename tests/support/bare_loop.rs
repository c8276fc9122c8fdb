//! A servo loop without its safety chain and its passivity controller: what they are measured against.

use palpate::servo::contact_model::ContactModel;
use palpate::servo::coupling::{Coupling, Proxy};
use palpate::servo::device::DeviceDesc;
use palpate::servo::follower::Follower;
use palpate::servo::passivity::Observer;
use palpate::solver::tool::{ToolMotion, Wrench};

/// The law and the coupling alone.
pub struct BareLoop {
    follower: Follower,
    proxy: Option<Proxy>,
    observer: Observer,
    tick_s: f64,
}

impl BareLoop {
    /// With the tool where the device is.
    pub fn new(coupling: &Coupling, device: &ToolMotion, tick_s: f64) -> Self {
        let proxy = match coupling {
            Coupling::Direct => None,
            Coupling::Virtual(coupling) => Some(Proxy::new(coupling, &DeviceDesc::touch(), device)),
        };
        Self { follower: Follower::new(tick_s), proxy, observer: Observer::default(), tick_s }
    }

    /// One tick: the wrench that it would render, and where the tool is.
    pub fn tick(&mut self, device: &ToolMotion, newest: &ContactModel, now_s: f64) -> (Wrench, ToolMotion) {
        let tool = self.proxy.as_ref().map_or(*device, |proxy| *proxy.motion());
        if newest.sequence > 0 {
            self.follower.accept(newest, &tool, now_s);
        }
        let law = self.follower.law(&tool, now_s);
        let tick_s = self.tick_s;
        let wrench = self.proxy.as_mut().map_or(law.wrench, |proxy| proxy.advance(&law, device, tick_s)[0]);
        self.observer.look(device);
        self.observer.render(device, &wrench);
        (wrench, self.proxy.as_ref().map_or(*device, |proxy| *proxy.motion()))
    }

    /// The least energy that the hand had ever put into the loop, in J.
    pub fn least_j(&self) -> f64 {
        self.observer.least_j()
    }
}
