"""Places as mariners read them: degrees and minutes."""


def minutes_text(degrees: float, signs: str, decimals: int = 0) -> str:
    """Return a latitude (signs ``NS``) or a longitude (``EW``) in degrees and minutes, such as 57°41'N.

    decimals : of the minutes
    """
    if signs == "EW":
        degrees = (degrees + 180.0) % 360.0 - 180.0
    minutes = round(abs(degrees) * 60.0, decimals)
    whole = int(minutes // 60.0)
    width = 2 if decimals == 0 else 3 + decimals
    sign = signs[1 if degrees < 0.0 else 0]
    return f"{whole:0{2 if signs == 'NS' else 3}d}°{minutes - 60.0 * whole:0{width}.{decimals}f}'{sign}"


def place_text(lon: float, lat: float) -> str:
    """Return a place in degrees and minutes, to a tenth of a minute (185 m): 57°41.2'N 010°05.0'E."""
    return f"{minutes_text(lat, 'NS', 1)} {minutes_text(lon, 'EW', 1)}"
