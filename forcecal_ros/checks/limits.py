"""What a recording may have, in numbers: every limit of the checks, and why it is set so."""

# Values ------------------------------------------------------------------------------------------

ABSURD = 1e6
"""A reading beyond this is none, in N, N m, V, m/s^2 or m: no wrist sensor reads a meganewton."""

ABSURD_RAW = 2.0**32
"""The same of a raw channel before its matrix: counts of a converter have 32 bits at most."""

SPOILT = 0.01
"""From this share of samples on that are no readings a stream is not to be trusted: a wrench of
1 kHz misses ten a second then, which no driver does that works."""

FEW = 5
"""So many may be missing of any stream: of 24 static poses one would be 4 %."""

STARTUP = 20.0
"""A driver that publishes before its sensor answers says nothing, or zeros, for so long at most
[s]; half of a recording at most."""

# Values that repeat ------------------------------------------------------------------------------

DEAD = 100
"""So many samples of one value are no chance; sets of static poses have fewer."""

STUCK, STUCK_SAMPLES = 0.5, 50
"""A channel that repeats itself for less [s] or for fewer samples may be at its limit, or held by
its driver. Noise of one resolution repeats itself so often once in 10^20 times."""

HABIT = 20.0
"""Stuck is what repeats itself for so many times as long as what it does in 95 % of the rest."""

ABRUPT = 0.2
"""Changes just before a channel sticks, over the usual ones: noise goes on until it sticks, while
the signal of a simulator without noise comes to rest by ever smaller ones."""

COARSE = 0.1
"""Resolution over the usual change from which a channel may stand still at rest, because it does
not resolve its own noise (a third of it, in noise that motion has made ten times as strong)."""

ALIKE = 0.5
"""Such a channel is stuck where the others of its sensor change by this share of what they
usually do: then it is not rest that keeps it."""

TURNED = 0.1
"""A robot that turns by so much turns gravity by 6 deg: no force sensor and no accelerometer
says the same before and after [rad]."""

# Values at a limit, values in steps --------------------------------------------------------------

CLIPPED = 5
"""Samples at the very same extreme value, half of them in a row, that count as clipping: of noise
that has no limit the extreme is reached once."""

ROUNDING = 1e-9
"""Noise below this share of a channel's value is rounding: simulated without noise, it rests at
its extreme."""

LEAP, WRAPS, SMOOTH, STAYS = 0.8, 2, 0.02, 5
"""Steps of that share of all that a channel does, while half of its steps are below the third
number, and half of them begin and end so near to the ends of the range: counts that wrap around.
They stay at one end and then at the other for so many samples, so many times; spikes do not."""

SYMMETRIC = 0.01
"""Share of the range by which its ends may differ in size where one such step is enough, from
and to where the channel stays for :data:`DEAD` samples: counts wrap at plus and minus the same."""

COUNTED = 64
"""Steps that a range has at least in which counts wrap around, a quarter of those of 8 bits: a
channel that says less moves by noise alone, from one end to the other as well."""

CLIPPED_IN_STEPS = 40
"""The same of a channel that comes in steps, which repeats its extreme now and then by chance."""

STEPS = 0.17
"""Step of values, in RMS of the noise, from which it matters: its rounding is 5 % of the noise."""

ROUGH = 2.0
"""Step, in RMS of the noise, from which the extreme is repeated like any other value."""

# Stamps ------------------------------------------------------------------------------------------

BACK = 1.0
"""Stamps that go back by more, twice, are a new clock; by less, messages out of order [s]."""

APART = 1.0
"""Streams that are so far apart do not overlap because their clocks differ [s]."""

PAUSE = 0.5
"""Silence for so long is no lost samples, but a pause [s]."""

PAUSE_PERIODS = 5.0
"""A slow stream, or one sample a pose, pauses only where it is silent for so many periods."""

PAUSES_TOLD = 5
"""More pauses of one stream than that are told in one sentence."""

SKEW = 1e-5
"""Relative difference of two clocks that is no rounding."""

FARTHEST = 0.02
"""Relative difference of two clocks beyond which the rate is another one."""

LOST = 5e-4
"""Fraction of missing samples that counts as dropouts."""

LOST_TOLD = 0.05
"""The same that is told: gaps of a few messages are bridged, and worth no word."""

JITTER = 0.15
"""Scatter of the stamps about their line, in periods, that counts."""

OFFSET_SPAN, OFFSET_STEP = 30.0, 0.05
"""Clocks are looked for so far apart, by means over so long: clocks that nobody set differ by
seconds, those of other days do not overlap [s]."""

OFFSET = 0.1
"""Stamps that differ by less may be a slow filter's or a driver's delay, not another clock [s]."""

OFFSET_EXPLAINS, OFFSET_TIMES = 0.8, 3.0
"""Share of a sensor's changes that gravity explains over the other clock, and how many times as
much is unexplained over that of the stamps: of sound recordings, pushed now and then or not, the
second is below 1.2."""

OFFSET_TURNED = 0.1
"""Spread of gravity's direction from which its turning times a recording, gravity taken as 1."""

# Poses that repeat, motion -----------------------------------------------------------------------

FROZEN = 0.3
"""A pose that repeats itself for less is a slow driver, not a frozen one [s]."""

LATE = 0.5
"""A robot that stands may follow a command so much later: planning, a busy computer [s]."""

LATE_AT_END = 1.0
"""The same at the end of a recording, where no sample shows whether it followed [s]."""

MOVED, TURNED = 0.002, 0.01
"""So far a tool has moved for certain [m], [rad]: reported poses resolve a tenth or better."""

JUMPED = 2.0
"""A pose that had been frozen goes on at so many times the speed that follows."""

RINGING = 1.0
"""After the robot has stopped its tool may shake the other sensors for so long [s]."""

AVERAGED = 0.25
"""Other sensors that tell of motion are averaged over so long, against ringing and noise [s]."""

CERTAIN = 20.0
"""A change of a mean by so many standard errors is neither noise nor what is left of ringing."""

LARGE = 0.25
"""A change by this share of all that a sensor does in the recording is a motion, not drift."""

TILTED = 0.05
"""A change by this share of an accelerometer's reading is a motion, not drift: 3 deg of tilt."""

SPEED, TURN_RATE = 0.005, 0.01
"""Faster than that a robot is on its way, not settling [m/s], [rad/s]."""

SLICE = 0.1
"""Speeds are differences of means over so long, which evens out a pose's noise [s]."""

BEFORE = 0.2
"""A motion that ends so shortly before a phase at rest still rings in it [s]."""

SETTLING = 0.5
"""Left out after a motion that reaches into a phase at rest, for the tool to ring down [s]."""

SHORTEST_REST = 0.3
"""So much of a phase at rest is kept [s]; what rings in it shows as drift within the pose."""

COARSE_PLACE = 1e-3
"""Positions in larger steps tell no acceleration [m]: robots report tenths of a millimetre."""

# Frames, axes and units --------------------------------------------------------------------------

TINY = 1e-300
"""Keeps a division by a noise or a weight of zero finite."""

TRUE = 1e-4
"""Share of the span of its forces to which no sensor is true: data sheets say 2e-3 or more."""

SPANNED = 0.1
"""Second spread of the directions of gravity, gravity taken as 1, from which poses tell a turn:
three that differ by 15 deg from each other."""

BY_CHANCE = 1e-6
"""Another frame is believed where chance makes it fit so much better less often than that: six
hypotheses for each of ten thousand recordings go wrong once in twenty then."""

NOISE_KNOWN = 2.0
"""The noise of a pose's mean is known to such a factor: what touches or pulls at a tool differs
from pose to pose and shows in none of them. In five poses of a peeler at work forces were off by
twice the noise, and the axes seemed turned by 15 +- 11 deg."""

ODDS = 1000.0
"""Hypotheses that the data prefer by less are both named."""

TURNED_OFF, TILTED_OFF = 3.0, 3.0
"""From so much on a sensor is turned, a base tilted, on purpose or by mistake, not by tolerances
of their mounts, and what is identified is wrong [deg]: flanges are pinned to 0.1 deg, floors level
to 1. Less takes 0.2 % off the mass, and is named in a note."""

SURE_WEIGHT = 3.0
"""A mass of fewer standard errors is none."""

EXPLAINED = 0.5
"""Share of the changes of forces at rest that a weight explains at least, in sum of squares: of
sound recordings it explains 0.98 or more, of wrenches laid to the wrong poses 0.3 or less."""

SURELY = 0.9
"""Share of the changes of torques that a weight explains where they are forces, and of those of
forces that it leaves: torques of a weight at one place follow it by half at most."""

OTHER_UNIT = 2.0
"""An accelerometer that at rest shows gravity wrong by this factor is in another unit: offsets of
those that are not calibrated are 1 m/s^2, gains 10 % off at most."""

SAME_UNIT = 0.2
"""It is in a unit that explains the factor to such a share, for those offsets and gains."""

OTHER_TORQUES = 3.0
"""Torques fit other axes where they leave so many times less: a cable or a contact of sound axes
leaves about the same with all."""

FAR = 0.3
"""A centre of mass so far away is questioned [m]: grippers and hands have theirs within 0.2."""

SAME_MASS = 0.05
"""A known tool weighs so nearly the same in another unit: another tool does by chance once in ten
times, of those that weigh a tenth, a quarter or a thousand times as much."""

SAME_LEVER = 0.05
"""A centre of mass is as many times as far as in another unit to this share, in size and across:
inertia tells it to 2 %, and lbf in and N m differ by 8.85, dN m by 10."""

LIKE_NONE, SAME_FAR_LEVER = 20.0, 0.3
"""So many times as far no other tool has it, so that it need not be so many times to a hundredth:
a rig's tool need not be the one that hung there to a tenth."""

TURNS_ALONG = 0.5
"""An accelerometer that sits on what the pose is of shows its turning to this share at least:
gains are 10 % off at most."""

NO_GRAVITY = 0.05
"""Less than this share of gravity is what an accelerometer without gravity shows of its offset."""

LIGHT = 0.25
"""A lighter tool is questioned [kg]: the lightest grippers of arms weigh 0.3 with their coupling,
and what weighs up to 2.4 kg is lighter in kgf, up to 1.1 kg in lbf."""

HEAVY = 200.0
"""A heavier tool is questioned [kg]: arms that carry as much are few, in mN 0.2 kg weigh so."""

NO_NOISE = 1.0
"""Forces without weight that change by more from pose to pose change for another reason [N]: noise
and drift of wrist sensors are below."""

VERTICAL = 0.1
"""A mean force this close to the vertical of base may be a weight [rad]; a bias points so by
chance once in four hundred times."""

FASTEST = 30.0
"""A hand that goes faster for a tenth of its motion is not in metres [m/s]: the fastest arms do
10, and the slowest motions, of 50 mm/s, come out as 50."""

SURE_SHOWN = 10.0
"""Standard errors by which inertia is off: they come from twelve parts of a recording."""

OTHER_LENGTH, UNSHOWN = 1.0, 0.1
"""A hand that moves faster than the first for a tenth of its motion [m/s], while forces show less
than the second of the inertia that its positions make, is in cm or inches: sound logs show 0.5 to
1, and 0.05 m/s come out as 2 in inches."""

SLOW_HAND, OVERSHOWN = 0.02, 30.0
"""A hand that moves no faster than the first [m/s], while forces show so many times the inertia,
is in m and taken for cm or mm: logs that were played slowly show 4 to 25 times, and 0.5 m/s come
out as 0.005 where m are taken for cm."""

# Pace --------------------------------------------------------------------------------------------

PACED = 100
"""Fewer readings tell no rate and no speed: sets of static poses have fewer."""

MOST_RATE = 50_000.0
"""No force sensor and no robot sends more readings a second [Hz]; 50 Hz in s read as ms do."""

SLOW_RATE, CREEPS = 5.0, 0.02
"""An arm that turns about, never faster than the second number [rad/s], in readings at less than
the first [Hz], is a log in another unit of time: 5 kHz come out as 5 Hz where ms are taken for s,
and 2 rad/s as 0.002, or as 0.02 where rows of 100 Hz were counted. Logs have 10 Hz and more, arms
turn by 0.1 rad/s and more."""

TURNED_ABOUT, SEEN_TURNING = 0.3, 0.35
"""An arm is watched as it turns where it turns by the first in all, and by less than the second
from one reading to the next; rows of poses turn by more [rad]."""

WHIRLS = 30.0
"""A hand that turns faster for a tenth of its motion is not in radians, or not in seconds [rad/s]:
the fastest wrists do 12, and those at work 0.6 to 3, which is 34 to 170 deg/s."""

TURNING, FOLLOWS_GYRO, LIKE_DEGREES = 0.1, 0.7, 0.25
"""A gyro is compared where the pose turns faster than the first [rad/s], or where the change of
specific force goes along with it to the second, a correlation. It is in deg/s where it is 57.3
times as fast, to the third: means over a tenth of a second lose a hundredth, contact more."""

SHORT_SLICE = 0.02
"""A turn is seen over so long, which evens out noise [s]: over more, 100 rad/s look like few."""

FAST_SHARE = 0.9
"""Speeds are those that a tenth of the recording exceeds: a few poses that leap are no speed."""

SAME_SPAN = 0.05
"""Two streams of which one lasts a thousand or a million times as long, to this share, are in
different units of time."""

# Live, sample by sample --------------------------------------------------------------------------

VISIBLE_TRAVEL, VISIBLE_TURN = 1e-3, 5e-3
"""Readings that repeat count as frozen only once the commands have moved that far [m], [rad]. A
pose published with four digits changes every 0.1 mm, and at the default pace the commands are
1 mm ahead of a robot that lags by 50 ms: what lags more shows as an error of tracking."""

SURELY_FROZEN = 5.0
"""Readings at rest that repeat for so many times as long as they use to are frozen: live, a false
alarm ends a motion, a miss is found in the recording."""

HABIT_EXCEPTIONS = 2
"""So many of the longest repetitions before a start are no habit: a sensor that had frozen."""

HABIT_CHANGES = 20
"""Fewer changes than that show no habit."""
