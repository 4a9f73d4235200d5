"""The thresholds, levels, counts and budgets on which the results of the lab depend.

Each comes with what it decides and the measurement behind it.  Step sizes, tolerances and grids are defined where they
are used: they change the accuracy of a computation, not the result.  "Error" is a root mean square; "gears" (base
``play``) are searched on short segments, all other motions as a whole (``lab.inverse``).
"""

import math
from statistics import NormalDist

# Levels, and the identification of a parameter

FALSE_NAME = 0.05
"""Chance of a false name in one step of a search, over all candidates of that step; and level of the tests of a
residual in a comparison: of a correlation, and of the false discoveries among all maps."""
CONFIDENCE = 0.95
"""Confidence level of every interval, also of those that must not contain zero."""
HALF_WIDTH = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
"""Half width of such an interval, in standard deviations of a normal variable."""
FALSE_LINE = 1e-3
"""Probability that noise is taken for a spectral line, or any band of its spectrum for more than noise."""
SPREAD = 1.6
"""Variance of the logarithms of the variances of blocks of a residual, over that of noise, above which it is not noise;
noise of a few hundred blocks stays within 1.3."""
IDENTIFIED = 0.5
"""A parameter is identified when its standard deviation is below this share of its value (its 95 % interval then
excludes zero), or of its scale.  By the scale alone, which is the initial value, a drift of 0.48 ± 0.10 was
identified when the fit began at 0.4, and not when it began at 0.05."""
FOLLOWS_STATE = 0.25
"""Share of the residual variance that a function of a state must explain for the residual to be described by it."""
FOLLOWS_ALSO = 0.8
"""Share of what the best state explains, for another one to be reported beside it."""
GOOD = 1.15
"""Times the noise: up to here the error of a comparison counts as noise."""
WORTH_RECORDING, SEEN = 1.5, 5.0
"""A motion is worth recording if models differ there by this factor more than in the recordings; and they are
distinguished if they differ by so many standard deviations over the length of a recording."""
RAILED = 6
"""Times as many readings at the largest or smallest value as at the next one, that mark the end of a range: 8 and 9
times as many of two accelerometers that were cut off, 2.4 of a sine in a hundred steps, and noise hardly repeats a
value.  So many readings of zero in a torque show that it is a magnitude."""
LOST_JUMP = 10.0
"""Times the largest usual step of an angle between two samples (its 95 % quantile), above which a jump away and back is
a reading that was lost.  Those of a robot arm jump by 40 times and more.  Of 540 other recordings of real machines none
has such a jump that comes back within five samples; pneumatic cylinders jump by up to 200 times, and stay."""

# Motions that are simulated whole, and inverse models

LEAST_GAIN = 0.05
"""Share of the squared error, or of a cost, that an effect has to take to be named, however significant it is.  The
effects known to be in the sets of ``bench.real`` take a quarter and more at their step.  Load-dependent friction that
took 2 % of a TX40's error (p = 0.001) halved the estimates of viscous and Coulomb friction, which are published.  A fit
to a simulated motion has to take it in its first few steps to be continued: effects that were named later had then
taken 30 % or more (servos and oscillators of ``bench.real``), and with a thousandth instead the names are the same."""
RIVAL_GAIN = 0.23
"""Share of the squared error of its rivals that an effect has to take.  Friction behind a play takes 0.26 to 0.44 of
what elastic Coulomb friction leaves on four sets of recordings of a friction damper with backlash, 0.13 to 0.19 on one
more, in which it is missed, and 0.46 to 0.92 on ten simulated joints.  On a joint that sticks and slips it takes 0.09,
on a cart 0.01 to 0.20, and beside a spring 0.29, for which the cart gets a play that it does not have."""
LEAST_SHARE = 1e-4
"""Share of the first model's squared error of a torque that an effect has to take: a hundredth of its amplitude.  On a
robot's shoulder gravity and three kinds of friction left 1e-4; a ripple and a spring that took 7e-6 and -1e-5 of the
error on unseen data were then significant.  The smallest effect that is known to be there in 60 real cases takes 4e-4
(viscous friction of a damper).  Simulated motions have no such limit: without its friction a part may be anywhere."""
STRUCTURED = 1.6
"""Times the noise within the band, above which the residual is more than noise.  It covers the error of the noise
floor, which is extrapolated from above the band."""
FOLDS = 3
"""Parts of the samples, each predicted by a fit to the others."""
BLOCK_CORRELATIONS = 4.0
"""Correlation times of the residual in a block: the means of neighbouring blocks are then nearly independent."""
LEAST_BLOCKS = 12
"""Fewest blocks, in all recordings together, for a t-test."""
LASTING_BLOCKS = 6
"""Blocks, in all recordings together, for an interval where a simulated motion leaves more than noise.  On 120 swings
with a torque that disturbs them for 0.1 to 5 s at a time, 95 % intervals with twelve blocks held 73 % of the
frequencies, viscous and dry frictions, with eight 81 and with six 87; in white noise six hold 96 %, and are 1.8 times
as wide as those that assume it."""
ENOUGH_RECORDINGS = 2
"""With so many recordings of the fit or more the selection uses their folds alone.  A single one has too little
motion for that: Coulomb friction that lowers the error on a pendulum's second recording from 0.28 to 0.10 N m had p
= 0.96 by the first.  If the last recording always were a fold, nothing would be named for a servo (XL330), however long
it is searched."""
MOST_EFFECTS = 6
"""Largest number of effects that are added."""
FINISHED = 5
"""Effects that survive the first stage of successive halving: after a few steps of every fit to a simulated motion,
and by the score test.  In the search with observers twice as many are evolved with the low gain, and this many are
proposed, with the best one of the high gain, which beside a hum was the hidden effect (tenth after the low gain): the
better half is fitted first, the others where none of it is accepted.  In 14 steps of five pairs (seeds 915 and 6400) a
hidden effect was first to ninth after the local minimum of each effect, and first to third after the low gain in 11; a
compliant shaft that was fifth beside drag took the error from 55 to 13 times the noise."""
LEAST_PERIODS = 2.0
"""A torque of N periods a turn is distinguished from a slowly varying one when the motion covers so many periods.  Of
the power of a sine over one period a cubic, which has as many parameters, leaves 4 % on average over its phases, 38 %
over 1.5 and 82 % over two.  With 1.0 a ripple of 4 a turn, over 1.8 periods, was named beside the drag of a pendulum;
with 0 one for the weight of an STS3215.  Of a motion that an input drives a quarter of it is enough if no more than
noise is left, as no other law does that: of nine servos, which cover 0.9 to 1.8 periods, five lacked their ripple."""

RESTS = 0.2
"""Share of the speed below which half of the way is made, below which a free motion has ended.  How a joint comes to
rest depends on how its friction is smoothed.  A share of the largest speed would be that of a jerk: a mass that was
shifted at once, then pulled slowly, held and let go, would count as moving during the jerk only."""

# The band in which a motion is compared

BAND_CLEAR = 30.0
"""The band ends where the angle's power density falls to this many times its noise.  Amplitudes exceed the noise by a
factor of five there; the acceleration's error is largest at the end of the band, about a fifth of its signal."""
BAND_MOTION = 0.9
"""Least share of the power of the speed that lies within the band: below it a swing contains nothing but noise.  Eleven
joints and motors of others have 0.99 and more in the band that identifies the inertia best.  A motor that turns a
flexible ruler, swept to 10 Hz, has 0.02 below 1.9 Hz: nothing was named there, by ten samples of each recording."""
BAND_AS_WELL, INERTIA_IDENTIFIED = 3.0, 0.1
"""Times the smallest relative standard deviation of the inertia, up to which a wider band is used, and the largest
at which the inertia counts as identified.  For an arm that vibrated at 18 Hz, not caused by its torque, this
deviation was 60 times smaller with a band to 10 Hz (J = 0.0635 kg m²) than with one to 80 Hz (0.0073), for a cart 57
times.  In ten other sets that identify the inertia the widest band was within a factor of 1.8 of the best."""
DELAY_SHARE = 1e-3
"""Least share of the power of the torque's derivative by a delay that inertia, friction and weight do not explain.  It
is 6e-5 in a motor under a sine, where only what the filter leaves of harmonics distinguishes them, and 0.007 to 0.4 in
seven measured motors and joints whose delays are significant."""
UNSURE_SPEED = 0.02
"""A part is at rest below this share of its usual speed: there dry friction may have any value up to its largest.  A
robot's joint that stands still for two thirds of a recording had no friction (p = 1) before samples at rest were left
out."""

# Time

BUDGET_S = 60.0
"""Default time budget of a search [s]."""
STAGE_SHARE = 0.9
"""Share of the remaining time for each stage of a search; the rest is for the validation, the elimination and the
report.  Without a share for the elimination, a pendulum whose search took the whole minute kept a viscous friction
that drag and Coulomb friction had made superfluous, and servos on busy cores took 77 to 92 s.  With a share of 0.75
for the search of gears a pair that needs 47 s was cut off, and a search that is cut off took no less in all (66 s;
seed 5300)."""
BUDGET_SAMPLES = 6400
"""Samples of gears that a search of a minute can use: two recordings of 4 s at 800 Hz, in steps of 0.5 ms, take half a
minute; three of 20 s had no answer after nine minutes."""

# Gears: evidence on unseen data

FAR = 1.6
"""Times the error of the same model on the shortest segments; below, the model is linear enough in the missing
effects for the score test alone to lead the search.  The free initial states of short segments follow any motion, so
that their error is what is added to the readings: noise and hum.  On segments of a second a model without a hum
leaves 0.7 to 1.9 times as much as on the shortest ones.  Without one of 17 other effects it leaves 1.8 to 19 times as
much in 15 cases; the two others, a compliant shaft (1.4) and a second mode (0.8), have errors below 1.7 times the
noise in any case (seeds 310 and 1210 of ``bench.hidden_effects``).  Relative to segments of a second, which also show
the second of two effects, nine times the noise would count as near: that lost two pairs of seed 1444."""
FAR_GAIN = 0.64
"""Share of the squared error that an effect of gears has to take where the error stays far above the noise: a wrong
effect can imitate a missing one a little.  Effects that are there took 0.67 to 0.86 (docs/decisions/0014); viscous
friction in the place of one with the cube of the speed took 0.25 (p = 0.002), Coulomb friction on a bar with
hysteresis 0.08."""
UNLIKE_NOISE = 2.0
"""Times the noise, above which the residual is not noise, whatever its shape: a steady hum can be fitted as coloured
noise.  Right models leave 0.8 to 1.6 times the noise as it was estimated.  A model with one effect of a pair left 2.3
times, without structure in the segments with the smallest errors."""
UNSIZED = 1.5
"""An amplitude smaller than so many half widths of its interval may be zero: three standard deviations.  The
amplitude of a second mode that was fitted to a hum of 1.5 m/s² was 1.01 half widths, that of a true one with a
participation of 0.15 was 47."""
LOST, LOST_SHARE = 1.3, 0.4
"""Times the usual error, above which an unseen segment is lost, to chaos or because its initial state was not found;
and the largest share of segments that are left out as lost, or whose initial states are searched for again.  The
other segments are surely followed.  If all count, gears with Coulomb friction and nothing else show a false structure
(test_unseen)."""
MISSED = 3.0
"""Times the usual error, above which a segment is missed: it has no weight in the parameters, its initial state is
searched for again, and its error is clipped there, as the error of a motion that cannot be simulated is infinite;
and times the noise, or the error of the shortest segments, above which a fit has lost the motion: no pair of gears
begins early with one that has lost the shortest segments.  A motion counts as not yet free where the error of its
acceleration is that large: simulated pendulums that are held for half a second and more reach 4.7 to 40 times, those
that are free from the first sample at most 1.2."""

# Gears: which effects are tried, and how far

BEHIND = 1.8
"""Times the error of the best on segments of one length, above which another effect, or the model without one, is
not fitted on longer ones, and the effect is needed.  The errors of true effects were at most 1.2 times that of the
best one (docs/decisions/0014).  Of simulated motions the same holds for fits whose errors hardly fall any more, and
of all motions for one fit to all recordings beside a fit to each: above, these may be of different machines."""


def is_less(error: float, other: float) -> bool:
    """Whether a root mean square error is less than another one by more than ``LEAST_GAIN`` of the other's square."""
    return error < math.sqrt(1 - LEAST_GAIN) * other
