"""The names of units in English, German, French, Spanish, Italian and Chinese, some in others.

Plain data for :mod:`.reading`. Names are looked up without regard to case and accents; each of
them means one unit in all of the languages (a German ``Grad`` is a degree, a French one a gon).
"""

from __future__ import annotations

import unicodedata

from .table import ANY_CASE, ATOMS

_NAMES = {
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes seg segs segundo "
    "segundos secondo secondi 秒 秒钟 сек 초",
    "ms": "msec msecs millisec millisecs millis 毫秒 мс ミリ秒 밀리초",
    "us": "usec usecs microsec micros 微秒",
    "ns": "nsec nanosec nanos 纳秒",
    "min": "min mins minute minutes minuten minuto minutos minuti 分 分钟 мин 분",
    "h": "h hr hrs hour hours stunde stunden heure heures hora horas ora ore 小时",
    "d": "day days jour jours dias giorno giorni 天",
    "m": "meter meters metern metre metres metro metros metri 米",
    "um": "micron microns 微米",
    "mm": "毫米 мм ミリメートル 밀리미터",
    "cm": "厘米 см",
    "km": "千米 公里",
    "inch": "inch inches zoll pouce pouces pulgada pulgadas pollice pollici 英寸",
    "ft": "foot feet pied pieds 英尺",
    "yd": "yard yards",
    "mile": "mile miles",
    "g": "gram grams gramm gramme grammes gramo gramos grammo grammi 克",
    "kg": "kilo kilos 千克 公斤",
    "t": "tonne tonnes tonnen tonelada toneladas tonnellata tonnellate 吨",
    "lb": "pound pounds 磅",
    "oz": "ounce ounces",
    "N": "newton newtons 牛 牛顿",
    "kN": "千牛 千牛顿 кн",
    "lbf": "poundforce poundsforce 磅力",
    "kgf": "kilopond kiloponds 公斤力 千克力",
    "N m": "newtonmeter newtonmeters newtonmetern newtonmetre newtonmetres 牛米 牛顿米",
    "kN m": "千牛米",
    "Pa": "pascal pascals 帕 帕斯卡",
    "kPa": "千帕",
    "MPa": "兆帕",
    "bar": "bar bars bares 巴 бар",
    "mbar": "毫巴",
    "atm": "atmosphere atmospheres",
    "V": "volt volts voltios voltio 伏 伏特",
    "mV": "毫伏",
    "A": "ampere amperes amperio amperios amp amps 安 安培",
    "mA": "毫安",
    "W": "watt watts vatio vatios 瓦",
    "kW": "千瓦",
    "Hz": "hertz hercio hercios 赫 赫兹",
    "kHz": "千赫",
    "ohm": "ohm ohms 欧 欧姆",
    "rad": "rad radian radians radiant radianten radiante radianti radianes 弧度",
    "deg": "deg degree degrees winkelgrad grados grado gradi degre degres 度 град градус 도",
    "gon": "gon neugrad gradian gradians",
    "rev": "rev revolution revolutions umdrehung umdrehungen umdr tours tour giri giro vueltas "
    "vuelta revoluciones 转 об",
    "l": "l liter liters litre litres litro litros litri ltr 升",
    "gallon": "gallon gallons",
    "1": "count counts increment increments inkrement inkremente inkr impulses impulsi pulsos "
    "incrementi incrementos 脉冲 计数",
    "%": "percent prozent pourcent porcentaje percento 百分比",
    "degC": "celsius degcelsius",
    "degF": "fahrenheit",
    "K": "kelvin",
}
_PREFIXES = {
    "n": "nano", "u": "micro mikro", "m": "milli mili", "c": "centi zenti", "d": "deci dezi",
    "da": "deca deka", "h": "hecto hekto etto", "k": "kilo chilo quilo kilo", "M": "mega",
}  # fmt: skip
# Of which units the names are written with a prefix: "Millimeter", "kilopascals", "milisegundos".
_PREFIXED = ("s", "m", "g", "N", "N m", "Pa", "bar", "V", "A", "W", "Hz", "rad", "l")


def fold(word: str) -> str:
    """A word without case and accents."""
    apart = unicodedata.normalize("NFD", word.casefold())
    return "".join(c for c in apart if not unicodedata.combining(c))


def _is_only(prefix: str, unit: str) -> bool:
    """Return whether a prefix before a name ("mVolt") is that one in any case."""
    return len(prefix) == 1 and f"{prefix.swapcase()}{unit}" not in ATOMS and prefix != "M"


def _words() -> dict[str, str]:
    words = {fold(w): unit for unit, names in _NAMES.items() for w in names.split()}
    for unit in _PREFIXED:
        names = [fold(w) for w in _NAMES[unit].split() if len(w) > 2]
        for prefix, spoken in _PREFIXES.items():
            if f"{prefix}{unit.split()[0]}" in ATOMS:
                spoken_or_not = (
                    [*spoken.split(), prefix] if _is_only(prefix, unit) else spoken.split()
                )
                made = {p + n: f"{prefix}{unit}" for p in spoken_or_not for n in names}
                words = made | words
    return words


WORDS = ANY_CASE | _words()
# The characters of the Chinese names: a text of nothing else is meant as a unit.
CHARACTERS = {c for names in _NAMES.values() for c in names if ord(c) > 0x2E80} | set("千兆百尺寸")
# What a misspelt unit is compared with.
UNIT_NAMES = [word for word in WORDS if len(word) > 4 and word.isascii()]
# Short words and abbreviations that stand in brackets beside names and are no units.
_REMARKS = (
    "act ist soll ref set sp pv fb cmd raw in out top bot rod cap mid new old est sim exp cal fil "
    "avg max min rms std abs rel pos neg fwd rev ext ret cw ccw up dn lo hi low med on off aux "
    "adc dac plc daq ai ao di do ch lvdt id no nr hp lp vl rl ein aus auf zu von bis re li x y z "
    "fit lag tot sum net ist one two all ok dc ac opt aktiv mes cde "
    "oil air gas weg vel acc err dev sig run end arm leg box st nd rd th int dint uint real bool"
)
REMARKS = set(_REMARKS.split())
