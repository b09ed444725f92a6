//! One object: its hypotheses, their fits, and its way down the noise levels.

use nalgebra::Vector3;

use super::conditions::{Conditions, MIN_NOISE};
use super::fit::{Fit, Termination, Workspace, minimize, residual_level, residuals};
use super::hypothesis::{HYPOTHESES, Hypothesis};
use super::log_evidence::log_evidence;
use super::rounded::fit_rounded;
use super::rows::Rows;
use super::search::{Effort, first_ellipsoid, search_angular, search_rounded};
use super::shares::Shares;
use super::solid::{Family, Solid};

/// The fits of all hypotheses.
#[derive(Debug, Clone)]
pub(super) struct Hypotheses {
    /// The fit of the ellipsoid of any rotation, and those of the others.
    ellipsoid: Box<Fit>,
    fits: [Option<Box<Fit>>; HYPOTHESES],
    /// Log evidence of each; negative infinity where there is none.
    pub log_evidence: [f64; HYPOTHESES],
    /// Noise level of each fit.
    fitted_at: [f64; HYPOTHESES],
    pub chosen: Hypothesis,
    /// Other minima that a search found.
    pub others: Vec<(Hypothesis, Solid)>,
}

/// An object on its way through the scene's noise levels.
#[derive(Debug, Clone)]
pub(super) struct Object {
    pub rows: Rows,
    pub hypotheses: Hypotheses,
    /// Probability that it is upright, where its category determines it.
    pub upright_share: Option<f64>,
    /// Noise level that its own evidence prefers.
    pub own_level: f64,
    /// Noise level at which its rotations were scanned, and searched thoroughly.
    pub scanned_at: f64,
    searched_at: f64,
    /// Other bodies, and the logarithms of their odds.
    pub alternatives: Vec<(Solid, f64)>,
}

/// What is fitted.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    /// The family, if it is given.
    pub family: Option<Family>,
    /// Direction against gravity, if objects may be upright.
    pub up: Option<Vector3<f64>>,
}

impl Plan {
    /// The hypotheses besides the ellipsoid, in the order of their fits: a rounded body starts from the cuboid.
    pub(super) fn hypotheses(&self) -> Vec<Hypothesis> {
        let families = match self.family {
            Some(Family::Ellipsoid) => vec![],
            Some(family) => vec![family],
            None => vec![Family::Cuboid, Family::Cylinder, Family::Rounded],
        };
        let mut all: Vec<Hypothesis> = families.iter().map(|family| Hypothesis::of(*family, false)).collect();
        if self.up.is_some() {
            let round = matches!(self.family, None | Some(Family::Ellipsoid)).then_some(Family::Ellipsoid);
            all.extend(round.into_iter().chain(families).map(|family| Hypothesis::of(family, true)));
        }
        all
    }

    fn allows_ellipsoids(&self) -> bool {
        matches!(self.family, None | Some(Family::Ellipsoid))
    }
}

/// The scan, for every object.
const SCAN: Effort = Effort { rotations: 80, starts: 3, minima: 2, margin: 12.0, family_margin: 4.0 };

/// A thorough search, and one for boxes with less noise than [`FINE_NOISE`].
const SEARCH: Effort = Effort { rotations: 250, starts: 12, minima: 5, margin: 30.0, family_margin: f64::INFINITY };
const FINE_SEARCH: Effort = Effort { rotations: 250, starts: 120, minima: 48, margin: 200.0, ..SEARCH };

/// Noise level, in half sizes, below which minima are narrow and all objects are searched.
pub(super) const FINE_NOISE: f64 = 0.01;

/// Other minima of one hypothesis that are kept.
const MAX_OTHERS: usize = 3;

/// Between noise levels.
const REFIT: Termination = Termination::new(3e-2, 20);

/// A fit is not repeated when the logarithm of the noise level changed by less than this and it had converged to within this.
const SAME_LEVEL: f64 = 0.005;
const CONVERGED: f64 = 1e-2;

/// Log evidence behind the best from which a hypothesis is no longer refitted; a share of it where the level changed little.
const HOPELESS: f64 = 24.0;
const HOPELESS_NEARBY: f64 = 0.3 * HOPELESS;
const NEARBY_LEVEL: f64 = 0.5;

/// Typical residual in units of the noise above which an object does not go to lower levels.
const AT_LEVEL: f64 = 0.7;

/// Lowest factor of one step down.
const MIN_LEVEL_STEP: f64 = 1.0 / 3.0;

/// A step that lowers the evidence is undone and shortened by this power, down to the last one.
const SHORTER: f64 = 0.4;
const SHORTEST: f64 = 0.1;

/// Steps down.
const MAX_LEVEL_STEPS: usize = 16;

/// Alternatives are at least this probable, in log odds; candidates for them this.
const MIN_LOG_ODDS: f64 = -3.0;
const MIN_CANDIDATE_ODDS: f64 = -5.0;

/// Log odds from which an alternative takes the place of the fit: beyond a rounder family that was preferred.
const MIN_SWAP_LOG_ODDS: f64 = 1.0;

/// The end.
const LAST: Termination = Termination::new(1e-4, 200);

/// Alternatives that are kept.
const MAX_ALTERNATIVES: usize = 8;

impl Object {
    /// The object with the fit of an ellipsoid; `None` where that cannot be evaluated.
    pub(super) fn new(
        rows: Rows,
        upright_share: Option<f64>,
        conditions: &Conditions,
        work: &mut Workspace,
    ) -> Option<Self> {
        let fit = first_ellipsoid(&rows, conditions, work).filter(|fit| fit.equations.cost.is_finite())?;
        let hypotheses = Hypotheses {
            ellipsoid: Box::new(fit),
            fits: std::array::from_fn(|_| None),
            log_evidence: [f64::NEG_INFINITY; HYPOTHESES],
            fitted_at: [conditions.noise[0]; HYPOTHESES],
            chosen: Hypothesis::ELLIPSOID,
            others: Vec::new(),
        };
        let mut object = Self {
            rows,
            hypotheses,
            upright_share,
            own_level: conditions.noise[0],
            scanned_at: f64::INFINITY,
            searched_at: f64::INFINITY,
            alternatives: Vec::new(),
        };
        object.hypotheses.log_evidence[0] = object.log_evidence_of(&fit, conditions, work);
        Some(object)
    }

    /// The fit of the chosen hypothesis.
    pub(super) fn fit(&self) -> &Fit {
        self.fit_of(self.hypotheses.chosen).unwrap_or(&self.hypotheses.ellipsoid)
    }

    /// The fit of a hypothesis, if it has one; the ellipsoid of any rotation always has.
    pub(super) fn fit_of(&self, hypothesis: Hypothesis) -> Option<&Fit> {
        let Hypotheses { ellipsoid, fits, .. } = &self.hypotheses;
        if hypothesis == Hypothesis::ELLIPSOID { Some(ellipsoid) } else { fits[hypothesis.0].as_deref() }
    }

    pub(super) fn log_evidence_of(&self, fit: &Fit, conditions: &Conditions, work: &mut Workspace) -> f64 {
        log_evidence(&self.rows, fit, conditions, work).max(MIN_LOG_EVIDENCE)
    }

    /// Typical residual of the chosen body in units of the noise.
    pub(super) fn residual_level(&self, conditions: &Conditions, work: &mut Workspace) -> f64 {
        residuals(&self.rows, &self.fit().body, conditions, work);
        residual_level(work)
    }

    /// The most probable hypothesis, and its logarithm.
    fn best(&self, shares: &Shares) -> (Hypothesis, f64) {
        let prior = shares.log_priors(self.upright_share);
        let mut best = (self.hypotheses.chosen, f64::NEG_INFINITY);
        for h in Hypothesis::all().filter(|h| self.fit_of(*h).is_some()) {
            let probability = self.hypotheses.log_evidence[h.0] + prior[h.0];
            if probability > best.1 {
                best = (h, probability);
            }
        }
        best
    }

    /// Chooses the most probable hypothesis.
    pub(super) fn choose(&mut self, shares: &Shares) {
        self.hypotheses.chosen = self.best(shares).0;
    }

    fn put(&mut self, h: Hypothesis, fit: Fit, conditions: &Conditions) {
        if h == Hypothesis::ELLIPSOID {
            *self.hypotheses.ellipsoid = fit;
        } else {
            self.hypotheses.fits[h.0] = Some(Box::new(fit));
        }
        self.hypotheses.fitted_at[h.0] = conditions.noise[0];
    }

    /// Repeats the fit of one hypothesis.
    fn refit(&mut self, h: Hypothesis, conditions: &Conditions, work: &mut Workspace) {
        let Some(fit) = self.fit_of(h) else { return };
        let fitted_at = self.hypotheses.fitted_at[h.0];
        let is_rounded = h.family() == Family::Rounded;
        let at_level = (conditions.noise[0] / fitted_at).ln().abs() < SAME_LEVEL;
        if !is_rounded && at_level && fit.remaining < CONVERGED {
            return;
        }
        let fit = match is_rounded {
            true => fit_rounded(&self.rows, &fit.body, conditions, 1, work),
            false => minimize(&self.rows, &fit.body, conditions, REFIT, work),
        };
        self.put(h, fit, conditions);
    }

    /// Repeats the fits of all hypotheses that may still be the best.
    pub(super) fn refit_all(&mut self, conditions: &Conditions, shares: &Shares, plan: &Plan, work: &mut Workspace) {
        let best = self.best(shares).1;
        let prior = shares.log_priors(self.upright_share);
        for h in Hypothesis::all() {
            if self.fit_of(h).is_none() {
                continue;
            }
            let change = (conditions.noise[0] / self.hypotheses.fitted_at[h.0]).ln().abs();
            let hopeless = if change > NEARBY_LEVEL { HOPELESS } else { HOPELESS_NEARBY };
            if self.hypotheses.log_evidence[h.0] + prior[h.0] < best - hopeless {
                continue;
            }
            self.refit(h, conditions, work);
            self.update_evidence(h, conditions, plan, work);
        }
    }

    fn update_evidence(&mut self, h: Hypothesis, conditions: &Conditions, plan: &Plan, work: &mut Workspace) {
        let counts = h.family() != Family::Ellipsoid || plan.allows_ellipsoids();
        self.hypotheses.log_evidence[h.0] = match self.fit_of(h) {
            Some(fit) if counts => self.log_evidence_of(fit, conditions, work),
            _ => f64::NEG_INFINITY,
        };
    }

    /// Scans the rotations for all hypotheses; fits of before are kept where they are better.
    pub(super) fn scan(&mut self, plan: &Plan, conditions: &Conditions, work: &mut Workspace) {
        // Minima have not converged when families are dropped: the margin grows with the rows.
        let family_margin = match plan.family {
            None => SCAN.family_margin.max(0.5 * self.rows.views.len() as f64),
            Some(_) => f64::INFINITY,
        };
        self.search(plan, conditions, &Effort { family_margin, ..SCAN }, work);
        self.scanned_at = conditions.noise[0];
    }

    /// The same thoroughly; whether it found something more probable.
    pub(super) fn search_deeply(
        &mut self,
        plan: &Plan,
        conditions: &Conditions,
        shares: &Shares,
        work: &mut Workspace,
    ) -> bool {
        const MIN_IMPROVEMENT: f64 = 3.0;
        let before = self.best(shares).1;
        let effort = if conditions.noise[0] < FINE_NOISE { FINE_SEARCH } else { SEARCH };
        self.search(plan, conditions, &effort, work);
        (self.scanned_at, self.searched_at) = (conditions.noise[0], conditions.noise[0]);
        self.best(shares).1 > before + MIN_IMPROVEMENT
    }

    /// Whether the last thorough search was at a much higher level.
    pub(super) fn may_be_searched(&self, conditions: &Conditions) -> bool {
        self.searched_at > 2.0 * conditions.noise[0]
    }

    fn search(&mut self, plan: &Plan, conditions: &Conditions, effort: &Effort, work: &mut Workspace) {
        self.refit(Hypothesis::ELLIPSOID, conditions, work);
        self.update_evidence(Hypothesis::ELLIPSOID, conditions, plan, work);
        let ellipsoid = *self.hypotheses.ellipsoid;
        for h in plan.hypotheses() {
            let up = plan.up.filter(|_| h.is_upright());
            self.refit(h, conditions, work);
            let rows = &self.rows;
            let found = match h.family() {
                Family::Ellipsoid => {
                    let start = Solid { up, ..ellipsoid.body };
                    vec![minimize(rows, &start, conditions, Termination::new(3e-2, 10), work)]
                }
                Family::Rounded => {
                    let known = self.fit_of(Hypothesis::of(Family::Cuboid, h.is_upright())).copied();
                    // Where rounded bodies are asked for there are no cuboids to start from.
                    let cuboids = match plan.family {
                        None => Vec::from_iter(known),
                        Some(_) => search_angular(rows, Family::Cuboid, &ellipsoid.body, up, conditions, effort, work),
                    };
                    search_rounded(rows, &ellipsoid, &cuboids, up, conditions, effort.family_margin, work)
                }
                family => search_angular(rows, family, &ellipsoid.body, up, conditions, effort, work),
            };
            self.take(h, &found, conditions);
            self.update_evidence(h, conditions, plan, work);
        }
    }

    /// The best of the minima, or the fit of before; the rest become others.
    fn take(&mut self, h: Hypothesis, found: &[Fit], conditions: &Conditions) {
        self.hypotheses.others.retain(|(other, _)| *other != h);
        self.hypotheses.others.extend(found.iter().skip(1).take(MAX_OTHERS).map(|fit| (h, fit.body)));
        let Some(new) = found.first() else { return };
        match self.fit_of(h).map(|fit| (fit.equations.cost, fit.body)) {
            Some((cost, _)) if cost <= new.equations.cost => {}
            before => {
                self.hypotheses.others.extend(before.map(|(_, body)| (h, body)));
                self.put(h, *new, conditions);
            }
        }
    }

    /// Lowers the noise level in steps of at most a factor of three while the object's own evidence grows.
    pub(super) fn descend(&mut self, conditions: &Conditions, shares: &Shares, plan: &Plan, work: &mut Workspace) {
        let mut level = conditions.noise[0];
        let mut evidence = self.log_evidence_of(self.fit(), conditions, work);
        let mut power = 1.0f64;
        self.own_level = level;
        for _ in 0..MAX_LEVEL_STEPS {
            let own = self.residual_level(&conditions.at(level), work);
            if own.is_nan() || own >= AT_LEVEL || level <= MIN_NOISE {
                break;
            }
            let lower = (level * own.max(MIN_LEVEL_STEP).powf(power)).max(MIN_NOISE);
            let at_lower = conditions.at(lower);
            let before = self.hypotheses.clone();
            self.refit_all(&at_lower, shares, plan, work);
            self.choose(shares);
            let found = self.log_evidence_of(self.fit(), &at_lower, work);
            if found > evidence {
                (evidence, level) = (found, lower);
                self.own_level = level;
            } else {
                self.hypotheses = before;
                power *= SHORTER;
                if power < SHORTEST {
                    break;
                }
            }
        }
    }

    /// The last fit, and other bodies that are not much less probable.
    pub(super) fn finish(&mut self, conditions: &Conditions, shares: &Shares, plan: &Plan, work: &mut Workspace) {
        let h = self.hypotheses.chosen;
        let before = *self.fit();
        let mut fit = minimize(&self.rows, &before.body, conditions, LAST, work);
        fit.log_share_evidence = before.log_share_evidence;
        self.put(h, fit, conditions);
        self.find_alternatives(&fit, conditions, shares, plan, work);
    }

    fn find_alternatives(
        &mut self,
        fit: &Fit,
        conditions: &Conditions,
        shares: &Shares,
        plan: &Plan,
        work: &mut Workspace,
    ) {
        let Hypotheses { chosen, log_evidence, others, .. } = &self.hypotheses;
        let prior = shares.log_priors(self.upright_share);
        let own = self.log_evidence_of(fit, conditions, work) + prior[chosen.0];
        let may_be = |h: &Hypothesis| log_evidence[h.0] + prior[h.0] > own + MIN_CANDIDATE_ODDS;
        let of_hypotheses =
            Hypothesis::all().filter(|h| h != chosen && may_be(h)).filter_map(|h| Some((h, self.fit_of(h)?.body)));
        let of_minima = others.iter().copied().filter(|(h, _)| (h == chosen || may_be(h)) && self.fit_of(*h).is_some());
        let mut found: Vec<(Hypothesis, Fit, f64)> = Vec::new();
        for (h, body) in of_hypotheses.chain(of_minima) {
            if plan.family.is_some() && h.family() != chosen.family() {
                continue;
            }
            const MAX_DECREASE: f64 = 30.0;
            const MAX_COST_GAP: f64 = 14.0;
            let mut other = minimize(&self.rows, &body, conditions, Termination::new(0.3, 1), work);
            if other.equations.cost - other.remaining.clamp(0.0, MAX_DECREASE) > fit.equations.cost + MAX_COST_GAP {
                continue;
            }
            other = match h.family() {
                Family::Rounded => fit_rounded(&self.rows, &other.body, conditions, 1, work),
                _ => minimize(&self.rows, &other.body, conditions, Termination::new(3e-2, 6), work),
            };
            let log_odds = self.log_evidence_of(&other, conditions, work) + prior[h.0] - own;
            let is_new =
                !other.body.is_like(&fit.body) && !found.iter().any(|(_, one, _)| one.body.is_like(&other.body));
            if log_odds > MIN_LOG_ODDS && is_new {
                found.push((h, other, log_odds));
            }
        }
        found.sort_by(|a, b| b.2.total_cmp(&a.2));
        let better = found.first().copied().filter(|(.., log_odds)| *log_odds > MIN_SWAP_LOG_ODDS);
        let better_by = better.map_or(0.0, |(.., log_odds)| log_odds);
        let mut alternatives: Vec<(Solid, f64)> = found
            .iter()
            .skip(usize::from(better.is_some()))
            .map(|(_, one, odds)| (one.body, odds - better_by))
            .collect();
        if let Some((h, better, log_odds)) = better {
            alternatives.push((fit.body, -log_odds));
            alternatives.retain(|(_, log_odds)| *log_odds > MIN_LOG_ODDS);
            alternatives.sort_by(|a, b| b.1.total_cmp(&a.1));
            let ended = minimize(&self.rows, &better.body, conditions, LAST, work);
            self.put(h, Fit { log_share_evidence: better.log_share_evidence, ..ended }, conditions);
            self.hypotheses.chosen = h;
        }
        alternatives.truncate(MAX_ALTERNATIVES);
        self.alternatives = alternatives;
    }
}

/// Log evidence of a fit that cannot be evaluated.
const MIN_LOG_EVIDENCE: f64 = -1e12;
