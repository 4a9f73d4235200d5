"""What the lab decides by: every threshold, level, count and budget that changes what is named or told.

Each says what it decides and the measurement behind it.  Step sizes, tolerances and grids stay where they are used:
they change how exactly something is computed, not what is said of it.  "Error" is a root mean square; "gears" (base
``play``) are searched on short segments, all other motions as a whole (``lab.inverse``).
"""

from statistics import NormalDist

# Levels, and what is told of a parameter

FALSE_NAME = 0.05
"""Chance of a false name in one step of a search, over all candidates of that step."""
CONFIDENCE = 0.95
"""Of every interval that is told, and of those that must not hold zero."""
HALF_WIDTH = NormalDist().inv_cdf((1 + CONFIDENCE) / 2)
"""Standard deviations of a normal variable to either side of such an interval."""
SIGNIFICANT = 0.05
"""Level of the tests of a residual in a comparison: of a correlation, and of the false discoveries among all maps."""
FALSE_LINE = 1e-3
"""Chance with which noise may pass for a line, or any band of its spectrum for more than noise."""
SPREAD = 1.6
"""Variance of the logarithms of the variances of blocks of a residual, over that of noise, from which on it is none;
noise of a few hundred blocks stays within 1.3."""
IDENTIFIED = 0.5
"""A parameter is told when its standard deviation is below this share of its value (its 95 % interval then does not
hold zero), or of its scale.  By the scale alone, which is the first value, a drift of 0.48 ± 0.10 was told from a first
value of 0.4 and not from 0.05."""
FOLLOWS_STATE = 0.25
"""Share of the variance of what is left, on blocks that were left out, that a state must explain to be told as what it
follows."""
FOLLOWS_ALSO = 0.8
"""Share of what the best state explains, for another one to be told beside it."""
GOOD = 1.15
"""Times the noise up to which the error of a comparison is the noise's own."""
WORTH_RECORDING, SEEN = 1.5, 5.0
"""Times what the recordings show already, for a motion to be worth recording; and standard deviations by which models
must differ there over the length of a recording, to be told apart."""
RAILED = 6
"""So many readings of the very same largest size, in one recording, are the end of a range: noise does not repeat
itself like that."""

# Motions that are simulated whole, and inverse models

LEAST_GAIN = 0.05
"""Share of the squared error, or of a cost, that an effect has to take, however sure it is: less is not worth a name.
What is surely in the sets of ``bench.real`` takes a quarter and more at its step; load-dependent friction that took 2 %
of a TX40's error (p = 0.001) halved the viscous and the Coulomb friction, which are published."""
LEAST_SHARE = 1e-4
"""Share of the squared error of the model as it was, a hundredth of its amplitude, that an effect has to take: of a
robot's shoulder gravity and three kinds of friction left 1e-4, and a ripple and a spring that took 7e-6 and -1e-5 of
the error on unseen data were significant.  Of 60 real cases the smallest that is surely there takes 4e-4 (viscous
friction of a damper)."""
STRUCTURED = 1.6
"""Times the noise within the band, from which on the residual holds more than noise: the error of the floor itself,
which is an extrapolation from above the band."""
FOLDS = 3
"""Parts of the samples, each predicted by a fit to the others."""
BLOCK_CORRELATIONS = 4.0
"""Correlation times of the residual in a block: the means of neighbouring blocks are then nearly independent."""
LEAST_BLOCKS = 12
"""Blocks in all recordings together; with fewer, a t-test tells nothing."""
ENOUGH_RECORDINGS = 2
"""Recordings of the fit from which on their folds alone choose.  A single one has too little motion for that: Coulomb
friction that takes the error of a pendulum's second recording from 0.28 to 0.10 N m had p = 0.96 by the first."""
MOST_EFFECTS = 6
"""Effects that are added at most."""
FIRSTS = 3
"""Effects that are tried as the first of two, those that explain most alone."""
FINISHED = 5
"""Effects that go on after the first stage of successive halving: whose fit to a simulated motion is finished after all
have had a few steps, that observers follow to the end, or that the score test asks for most.  Of hidden effects, one
that is there was among the first three after the first generations of observers (docs/decisions/0009)."""
LEAST_PROMISE = 1e-3
"""Share of the squared error that an effect has to take in these few steps to be finished: those that went on to a name
had taken 30 % at least (servos and oscillators of ``bench.real``), those that stayed at zero less than 3e-4."""
NEAR_REST = 0.5
"""Of the usual speed: an effect near rest that reaches further cannot be told from one of all speeds."""
DISSIPATES = 0.5
"""Correlation of a torque and the speed, from which on it takes energy: of friction 0.8 and more, of a weight zero."""
LEAST_PERIODS = 2.0
"""A torque of N periods a turn is told from one that varies slowly when the motion covers so many of them."""

# The band in which a motion is compared

BAND_CLEAR = 30.0
"""The band ends where the angle's power density falls to this many times its noise.  Amplitudes stand out of the noise
by a factor of five there; the acceleration's error is largest at the end of the band, about a fifth of its signal."""
BAND_MOTION = 0.9
"""Share of the power of the speed that lies within the band: below, a swing has nothing but noise too."""
BAND_AS_WELL, INERTIA_IDENTIFIED = 3.0, 0.1
"""Times the smallest relative standard deviation of the inertia, up to which a wider band tells it as well, and the
largest that tells it at all.  An arm that quivered at 18 Hz, which its torque did not make, told its inertia 60 times
as well below 10 Hz as below 80 Hz (0.0635 instead of 0.0073 kg m²), a cart 57 times; of ten other sets that tell it at
all the widest band was within 1.8 of the best."""
UNSURE_SPEED, SURE_SPEED, SLOW_SPEED = 0.02, 3.0, 0.25
"""A part is at rest below this share of its usual speed, or below so many standard deviations of the speed's noise, but
never above this share of the usual speed: there dry friction may have any value up to its largest.  A robot's joint
that stands still for two thirds of a recording had no friction (p = 1) before samples at rest were left out."""

# Time

BUDGET_S = 60.0
"""What a person waits for an answer [s]."""
STAGE_SHARE = 0.9
"""Of the time that is left, for each stage of a search; the rest is for what follows: the judging of what was fitted,
the elimination, and the report.  Without one for the elimination a viscous friction that drag and Coulomb friction had
made superfluous was named of a pendulum whose search took all of a minute; servos on busy cores took 77 to 92 s."""
SEARCH_SHARE = 0.75
"""Of the budget, for a search of gears; the rest is for the last refinement and for the description of what is left."""
BUDGET_SAMPLES = 6400
"""Samples of gears that a search of a minute can use: two recordings of 4 s at 800 Hz, in steps of 0.5 ms, take half a
minute; three of 20 s had no answer after nine minutes."""

# Gears: evidence on data that no fit has seen

FAR = 1.6
"""Times what the shortest segments leave of the same model; below, it is linear enough in what is missing for the score
test alone to lead the search.  Their free starts follow any motion, so that they leave what is added to the readings,
the noise and what hums beside it.  Hums leave 0.7 to 1.9 times as much of a second as of these; of 17 other effects
15 leave 1.8 to 19 times as much, a compliant shaft 1.4 and a second mode 0.8, whose errors are below 1.7 times the
noise in any case (seeds 310 and 1210 of ``bench.hidden_effects``).  Over what segments of a second leave, which hold
the second of two effects, too, nine times the noise was near: two pairs of seed 1444 were lost by that."""
FAR_GAIN = 0.6
"""Where it stays far above the noise, an effect must lower the error on unseen data to this part: what bends itself a
little to something else is no effect.  In the cases of docs/decisions/0009 those that are there came to 0.41
and 0.57 of it, others to 0.92 and more, as Coulomb friction of a bar with hysteresis, whose segments it fits better by
4 %."""
ALIKE = 0.01
"""Errors of unseen data that differ by this share count as equal: an effect that gains no more is not named, and of
those that explain as much the simplest is taken, the others are told as confusable.  In the cases of
docs/decisions/0009 needless effects gained at most 0.0004 near the noise (a second mode in a hum 0.05, which the
elimination takes out), those that are there 0.15 and more, the right one of several that delay 0.25 and more."""
UNLIKE_NOISE = 2.0
"""Times the noise, from which on what is left is no noise, whatever its shape: a steady hum passes for its colour.
Right models leave 0.8 to 1.6 times the noise as it was estimated; one of a pair without the other one left 2.3, and no
structure in the segments that are followed best."""
UNSIZED = 1.5
"""Half widths of its interval, within which an amplitude may as well be zero: three standard deviations.  A second mode
that was fitted to a hum of 1.5 m/s² had an amplitude of 1.01 of them, one of a participation of 0.15 one of 47."""
SURE_SHARE = 0.75
"""Of the unseen segments, those that are followed best: in the others a start may be off, which is no structure.  With
all of them gears with Coulomb friction and nothing else have something left (test_alternatives)."""
LOST, LOST_SHARE = 1.3, 0.4
"""Times the usual error, from which on an unseen segment is lost to chaos or to a start that was not found, and the
largest share of the segments that are left out for it, or whose starts are worth looking for."""
MISSED = 3.0
"""Times the usual error, from which on a segment is missed: it has no say in the parameters, begins anew, and counts
with no larger error than that; and times the noise, or the error of the shortest segments, from which on a fit has lost
the motion."""

# Gears: which effects are tried, and how far

MOST_MISSING = 3
"""After so many, nothing more is looked for."""
STANDS_OUT = 0.75
"""A function of what is left is believed that lowers the error to this part."""
BEHIND = 1.8
"""Times the error of the best on segments of one length, from which on another effect gets no longer ones.  Effects
that are there came to 1.2 times the best one's at most (docs/decisions/0009)."""
