"""Places as mariners read them: degrees and minutes."""


def minutes_text(degrees: float, signs: str) -> str:
    """Return a latitude (signs ``NS``) or a longitude (``EW``) in degrees and minutes, such as 57°41'N."""
    if signs == "EW":
        degrees = (degrees + 180.0) % 360.0 - 180.0
    whole, minutes = divmod(round(abs(degrees) * 60.0), 60)
    return f"{whole:0{2 if signs == 'NS' else 3}d}°{minutes:02d}'{signs[1 if degrees < 0.0 else 0]}"
