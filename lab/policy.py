"""What the lab decides by: every threshold, level, count and budget that changes what is named or told.

Each says what it decides and the measurement behind it.  Step sizes, tolerances and grids stay where they are used:
they change how exactly something is computed, not what is said of it.  "Error" is a root mean square; "gears" (base
``play``) are searched on short segments, all other motions as a whole (``lab.inverse``).
"""

# Levels, and what is told of a parameter

FALSE_NAME = 0.05
"""Chance of a false name in one step of a search, over all candidates of that step."""
CONFIDENCE = 0.95
"""Of every interval that is told, and of those that must not hold zero."""
TOLD = 0.5
"""A parameter is told when its standard deviation is below this share of its value, or of its scale."""
FOLLOWS_STATE = 0.15
"""Share of the variance of what is left, on blocks that were left out, that a state must explain to be told as what it
follows."""

# Motions that are simulated whole, and inverse models

LEAST_GAIN = 0.05
"""Share of the squared error that an effect has to take, however sure it is: less is not worth a name.  What is surely
in the sets of ``bench.real`` takes a quarter and more at its step; load-dependent friction that took 2 % of a TX40's
error (p = 0.001) halved the viscous and the Coulomb friction, which are published."""
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
"""Effects whose fit to a simulated motion is finished after all have had a few steps (successive halving)."""
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
BAND_AS_WELL, INERTIA_TOLD = 3.0, 0.1
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
SELECTION_SHARE = 0.9
"""Of the time that is left; the rest is for the elimination, without which a viscous friction that drag and Coulomb
friction had made superfluous was named of a pendulum whose search took all of a minute."""
