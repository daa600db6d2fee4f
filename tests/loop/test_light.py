import numpy as np

from zeromethod.loop.light_watch import LightWatch

SEEN = np.ones((10, 10), dtype=bool)


def grey(level: float) -> np.ndarray:
    return np.full((10, 10), level, dtype=np.float32)


def test_light_that_goes_out_is_noticed_and_its_return_too() -> None:
    watch = LightWatch(SEEN, black_grey=4)
    assert [watch.is_off(grey(x)) for x in (100, 100, 5, 4, 98)] == [False, False, True, True, False]


def test_a_touch_in_a_part_of_the_view_is_not_the_light() -> None:
    watch = LightWatch(SEEN, black_grey=4)
    watch.is_off(grey(100))
    touched = grey(100)
    touched[:6] = 4
    assert not watch.is_off(touched)


def test_slow_change_is_followed() -> None:
    watch = LightWatch(SEEN, black_grey=0)
    assert not any(watch.is_off(grey(100 * 0.99**k)) for k in range(300))
