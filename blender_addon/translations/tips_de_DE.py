"""German tooltips, by the English ones in one line."""

TIPS = {
    "16 bits, 32 in OpenEXR": "16 Bit, in OpenEXR 32",
    "16-bit PNG": "PNG mit 16 Bit",
    "16-bit TIFF": "TIFF mit 16 Bit",
    "32-bit float OpenEXR": "OpenEXR mit 32-Bit-Gleitkommazahlen",
    (
        "A Displace modifier: a mesh that can be seen in the viewport, sculpted and exported. What is finer than the "
        "mesh is lost"
    ): (
        "Ein Displace-Modifikator: ein Mesh, das man im Ansichtsfenster sehen, modellieren und exportieren kann. Was "
        "feiner ist als das Mesh, geht verloren"
    ),
    "A Displacement node: when rendering. What is finer than the mesh becomes bumps, so that all detail is there": (
        "Ein Displacement-Node: beim Rendern. Was feiner ist als das Mesh, wird zu Bump, so dass alles Detail da ist"
    ),
    "A network in an .onnx file": "Ein Netz in einer .onnx-Datei",
    "A texture for each unit square that the UVs lie in, numbered 1001, 1002 and so on. Size is that of each": (
        "Eine Textur für jedes Einheitsquadrat, in dem die UVs liegen, nummeriert 1001, 1002 und so weiter. Die "
        "Größe gilt für jede"
    ),
    (
        "Add rigs in a ring around the selected objects, with the settings of the rig; those that are there stay. "
        "The first one looks along +Y, as Blender's front view"
    ): (
        "Rigs in einem Ring um die ausgewählten Objekte setzen, mit den Einstellungen des Rigs; vorhandene bleiben. "
        "Das erste blickt entlang +Y, wie Blenders Ansicht von vorne"
    ),
    "Add the detail to the normal maps that the objects use, which stay as they are beneath": (
        "Das Detail auf die Normalmaps legen, die die Objekte tragen; darunter bleiben diese, wie sie sind"
    ),
    "Add three coloured lights and a camera around the selected objects, in place of an earlier rig": (
        "Drei farbige Lichter und eine Kamera um die ausgewählten Objekte setzen, anstelle eines früheren Rigs"
    ),
    ("Address of a Dask scheduler whose machines render training data, such as tls://host:8786. Empty: this machine"): (
        "Adresse eines Dask-Schedulers, dessen Rechner Trainingsdaten rendern, etwa tls://host:8786. Leer: dieser "
        "Rechner"
    ),
    (
        "Address of a Dask scheduler whose machines render, such as tls://host:8786. Empty: that of the preferences, "
        "where they have one"
    ): (
        "Adresse eines Dask-Schedulers, dessen Rechner rendern, etwa tls://host:8786. Leer: die der Einstellungen, "
        "falls sie eine haben"
    ),
    "All formats": "Alle Formate",
    "All selected mesh objects": "Alle ausgewählten Mesh-Objekte",
    "All that is baked shares one texture; the UVs of several objects must not overlap": (
        "Alles Gebackene teilt sich eine Textur; die UVs mehrerer Objekte dürfen sich nicht überlappen"
    ),
    "Along +X, as Blender's left view": "Entlang +X, wie Blenders Ansicht von links",
    "Along +Y, as Blender's front view": "Entlang +Y, wie Blenders Ansicht von vorne",
    "Along -X": "Entlang -X",
    "Along -Y": "Entlang -Y",
    "Also write a map of how far each normal can be trusted, for one photo": (
        "Auch schreiben, wie weit jeder Normale zu trauen ist, eine Karte für ein Foto"
    ),
    "Also write the surface's colour without light and shadow on it, made from the photo under white light": (
        "Auch die Farbe der Oberfläche ohne Licht und Schatten schreiben, aus dem Foto unter weißem Licht"
    ),
    "Make the albedo grey, for lights of unknown strengths": (
        "Eine Albedo ohne Farbe, wo die Stärken der Lichter nicht bekannt sind"
    ),
    "Angle in degrees between each light and the line from the object to the camera": (
        "Winkel in Grad zwischen jedem Licht und der Linie vom Objekt zur Kamera"
    ),
    "Apple computers, where the installed onnxruntime has it": "Apple-Rechner, wo das installierte onnxruntime es kann",
    "As a lens sees it": "Wie ein Objektiv es sieht",
    "As for a screen": "Wie für einen Bildschirm",
    "As set below; what another preset has set stays until it is changed": (
        "Wie unten eingestellt; was eine andere Voreinstellung gesetzt hat, bleibt bis zur Änderung"
    ),
    "As the 3D viewport looks at it now": "Wie das 3D-Ansichtsfenster es jetzt zeigt",
    (
        "Average the default network's answers on the scene turned and mirrored, and look twice at many colours: "
        "better, at half to a sixth of its speed. For stills; frames of a sequence or video get one pass"
    ): (
        "Die Antworten des Standardnetzes auf die gedrehte und gespiegelte Szene mitteln, und bei vielen Farben "
        "zweimal hinsehen: besser, bei 1/2 bis 1/6 der Geschwindigkeit. Für Standbilder; Bilder einer "
        "Sequenz oder eines Videos bekommen einen Durchlauf"
    ),
    "Bake the estimated normals into a texture on the target's UV map and give its material a Normal Map node": (
        "Die geschätzten Normalen in eine Textur auf der UV-Map des Ziels backen und seinem Material einen "
        "Normal-Map-Node geben"
    ),
    (
        "Bake the normals of all rigs of this scene together, each as its own camera saw them. Off: those of the "
        "chosen rig alone"
    ): (
        "Die Normalen aller Rigs dieser Szene zusammen backen, jede, wie ihre eigene Kamera sie sah. Aus: nur die "
        "des gewählten Rigs"
    ),
    "Begin another rig in this scene, with a photo and an estimate of its own; the rigs that are there stay": (
        "Ein weiteres Rig in dieser Szene beginnen, mit eigenem Foto und eigener Schätzung; vorhandene Rigs bleiben"
    ),
    "Bits per channel of the texture": "Bit je Kanal der Textur",
    "Blender renders the photo of an object in this scene, under a rig of lights": (
        "Blender rendert das Foto eines Objekts dieser Szene unter einem Rig von Lichtern"
    ),
    "Brightness of a white matte surface that faces the light, where 1 is full white": (
        "Helligkeit einer weißen matten Fläche, die dem Licht zugewandt ist; 1 ist volles Weiß"
    ),
    "CPU threads for networks. 0: all there are": "CPU-Threads für Netze. 0: alle vorhandenen",
    "Camera of this scene that took the photo: the one that Align Photo made, or one that you choose": (
        "Kamera dieser Szene, die das Foto aufgenommen hat: die, die Foto ausrichten gemacht hat, oder eine gewählte"
    ),
    "Camera that takes the photo: the rig's own, or any other of this scene": (
        "Kamera, die das Foto aufnimmt: die des Rigs oder irgendeine andere dieser Szene"
    ),
    "Camera whose focal length and shift the photo's camera gets, as of a calibrated lens or a cropped photo. Where it "
    "stands does not count. Empty: Lens (mm), and the photo's middle": (
        "Kamera, deren Brennweite und Verschiebung die Kamera des Fotos bekommt, wie die eines kalibrierten Objektivs "
        "oder eines beschnittenen Fotos. Wo sie steht, zählt nicht. Leer: Brennw. (mm) und die Mitte des Fotos"
    ),
    "Chen et al. 2018 for three lights, half the published width": (
        "Chen et al. 2018 für drei Lichter, halb so breit wie veröffentlicht"
    ),
    (
        "Click 4 to 12 places in the photo and the same places on the mesh, for Align Photo. The photo opens beside "
        "the viewport. Drag a marker to move it, X deletes the one under the mouse, Backspace takes the last one "
        "back, Esc ends"
    ): (
        "4 bis 12 Stellen im Foto und dieselben Stellen auf dem Mesh anklicken, für Foto ausrichten. Das Foto öffnet "
        "sich neben dem Ansichtsfenster. Eine Markierung lässt sich ziehen, X löscht die unter der Maus, die "
        "Rücktaste nimmt die letzte Stelle zurück, Esc beendet"
    ),
    "Closed lumps: smooth, folded, ridged, wrinkled or faceted": (
        "Geschlossene Klumpen: glatt, gefaltet, geriffelt, runzlig oder facettiert"
    ),
    "Collection of the rig's objects": "Sammlung der Objekte des Rigs",
    "Compare the estimated normals with the true ones: the angle between them in colour, its mean and its median": (
        "Die geschätzten Normalen mit den wahren vergleichen: den Winkel dazwischen in Farbe, sein Mittel und seinen "
        "Median"
    ),
    "Compare the photos' normals with the map": "Die Normalen der Fotos mit der Map vergleichen",
    "Convention, bit depth, format and automatic file name that a program expects; you can change each": (
        "Konvention, Farbtiefe, Format und automatischer Name, wie ein Programm sie erwartet; alles lässt sich ändern"
    ),
    "Copy that shows the coverage": "Kopie, die die Abdeckung zeigt",
    "Cycles samples a pixel for each of the three lights": "Cycles-Abtastwerte je Pixel für jedes der drei Lichter",
    "Cycles samples a pixel for each of the three lights: more take longer and give less noise": (
        "Cycles-Abtastwerte je Pixel für jedes der drei Lichter: mehr dauern länger und rauschen weniger"
    ),
    "Cycles samples a pixel, shared by the three lights: more take longer and give less noise": (
        "Cycles-Abtastwerte je Pixel, auf die drei Lichter verteilt: mehr dauern länger und rauschen weniger"
    ),
    (
        "Direction in degrees of the red light as the camera sees it: 0 is right, 90 is up. Green and blue follow at "
        "120 and 240 degrees more"
    ): (
        "Richtung des roten Lichts in Grad, wie die Kamera es sieht: 0 ist rechts, 90 ist oben. Grün und Blau folgen "
        "um 120 und 240 Grad weiter"
    ),
    (
        "Do this for all rigs of this scene, one after the other, each with its own settings. Off: for the chosen rig "
        "alone"
    ): (
        "Dies für alle Rigs dieser Szene tun, eines nach dem anderen, jedes mit seinen eigenen Einstellungen. Aus: nur "
        "für das gewählte Rig"
    ),
    "Discs at a distance: brighter and from a steeper direction where the object is nearer": (
        "Scheiben in einem Abstand: heller und steiler, wo das Objekt näher ist"
    ),
    "Empty that the lamp swings around": "Empty, um das die Lampe schwingt",
    "Empty that the lights turn to and that carries the rig: move it to move all of it": (
        "Empty, dem sich die Lichter zuwenden und das das Rig trägt: es zu bewegen bewegt alles"
    ),
    (
        "Estimate a photo for each camera, bring all into line with the mesh and bake them into one texture. Size, "
        "space, convention, margin, format, file, strength and what it goes on top of are those of the step Bake, "
        "the model is that of Estimate"
    ): (
        "Für jede Kamera ein Foto schätzen, alle mit dem Mesh in Einklang bringen und in eine Textur backen. Größe, "
        "Raum, Konvention, Rand, Format, Datei, Stärke und worauf sie kommt sind die des Schritts Backen, das Modell "
        "das von Schätzen"
    ),
    "Estimate the surface normals that the photo shows": "Die Normalen der Oberfläche schätzen, die das Foto zeigt",
    "File format of the heights. OpenEXR holds them in world units, the others from black to white": (
        "Dateiformat der Höhen. OpenEXR hält sie in Welteinheiten, die anderen von Schwarz bis Weiß"
    ),
    "File format of the normal map": "Dateiformat der Normalmap",
    "File format of the texture; one that cannot hold the chosen depth takes its own": (
        "Dateiformat der Textur; eines, das die gewählte Farbtiefe nicht fasst, nimmt seine eigene"
    ),
    "File of heights to write; what else is made goes beside it. Empty: a name of its own in the output folder": (
        "Zu schreibende Datei mit Höhen; was sonst gemacht wird, kommt daneben. Leer: ein eigener Name im Ausgabeordner"
    ),
    "File of the true normals of the photo's view. Empty: none": (
        "Datei der wahren Normalen der Ansicht des Fotos. Leer: keine"
    ),
    "File to write; its ending decides the format. Empty: a name of its own in the output folder": (
        "Zu schreibende Datei; ihre Endung bestimmt das Format. Leer: ein eigener Name im Ausgabeordner"
    ),
    "Fill what no view sees, by continuing the relief around it smoothly within each UV island": (
        "Füllen, was keine Ansicht sieht: es setzt das Relief ringsum weich fort, innerhalb jeder UV-Insel"
    ),
    "Find in the photo of a matt grey ball how the lights' colours mix, and add it to the rig file": (
        "Im Foto einer matten grauen Kugel finden, wie sich die Farben der Lichter mischen, und es der Rig-Datei "
        "hinzufügen"
    ),
    (
        "Find the camera that took a real photo from the mesh that it shows, and bake through that camera. Four "
        "pairs of points or more place it first, where there are any; the photo's outline and normals refine it"
    ): (
        "Die Kamera, die ein echtes Foto aufgenommen hat, anhand des Meshs finden, das es zeigt, und durch diese "
        "Kamera backen. Vier oder mehr Punktpaare platzieren sie zuerst, falls es welche gibt; Umriss und Normalen "
        "des Fotos verfeinern sie"
    ),
    "Find the three lights in the photo of a mirror ball, and write a rig file that the estimate then uses": (
        "Die drei Lichter im Foto einer Spiegelkugel finden und eine Rig-Datei schreiben, die die Schätzung dann "
        "benutzt"
    ),
    "Focal length in millimetres of the perspective camera, on a sensor 36 mm wide": (
        "Brennweite der perspektivischen Kamera in Millimetern, auf einem 36 mm breiten Sensor"
    ),
    ("35 mm equivalent focal length of the real camera, in millimetres. 0: the camera is assumed to be far away"): (
        "Kleinbildäquivalente Brennweite der echten Kamera in Millimetern. 0: die Kamera gilt als weit entfernt"
    ),
    (
        "35 mm equivalent focal length of the real camera, in millimetres. 0: the camera that the photo was "
        "rendered with, else the rig's"
    ): (
        "Kleinbildäquivalente Brennweite der echten Kamera in Millimetern. 0: die Kamera, mit der das Foto "
        "gerendert wurde, sonst die des Rigs"
    ),
    "Folder for each view's normals and albedo; the next run reuses them. Empty: they are not kept": (
        "Ordner für Normalen und Albedo jeder Ansicht; der nächste Lauf setzt dort fort. Leer: sie werden nicht "
        "behalten"
    ),
    "Folder for the demo's photo, normal map and texture. Empty: only the .blend file keeps them": (
        "Ordner für Foto, Normalmap und Textur der Demo. Leer: nur die .blend-Datei enthält sie"
    ),
    "Folder for the textures. Empty: a folder of its own in the output folder": (
        "Ordner für die Bilder. Leer: ein eigener Ordner im Ausgabeordner"
    ),
    (
        "Folder of photos of the same poses under white light (the three lights turned white), named like the "
        "photos or NAME_white: also bakes the surface's colour, to TEXTURE_albedo, matched where views "
        "overlap; photos from three folders, one for each light, are added up. Empty: no albedo is baked"
    ): (
        "Ordner mit Fotos derselben Posen unter weißem Licht, die drei Lichter auf Weiß gestellt, benannt wie die "
        "Fotos (auch NAME_white): die Farbe der Oberfläche wird mitgebacken, nach TEXTUR_albedo, angeglichen, wo "
        "mehrere Ansichten dasselbe sehen; von drei Ordnern, einem je Licht, werden die Fotos addiert. Leer: es wird "
        "keine Albedo gebacken"
    ),
    "Folder of these cameras' photos": "Ordner mit den Fotos dieser Kameras",
    (
        "Folder for the samples; one begun with the same settings is continued. Empty: a folder of its own in "
        "the output folder"
    ): (
        "Ordner der Beispiele; einer, den dieselben Einstellungen begonnen haben, wird fortgesetzt. Leer: ein "
        "eigener Ordner im Ausgabeordner"
    ),
    "Folder of mesh files to take shapes from": "Ordner mit Mesh-Dateien, aus denen Formen genommen werden",
    (
        "For a sequence of normals: take the target and the camera anew in each frame of the timeline, whose number "
        "is that of the normals. Off: as they stand now"
    ): (
        "Für eine Sequenz von Normalen: Ziel und Kamera in jedem Bild der Zeitleiste neu nehmen, dessen Nummer die "
        "der Normalen ist. Aus: wie sie jetzt stehen"
    ),
    "Four per pixel: takes about four times as long": "Vier je Pixel: etwa viermal so lange",
    "Fraction of the photos' relief that is added to the object's own surface: 1 as it is, 0 none": (
        "Bruchteil des Reliefs der Fotos, der auf die eigene Oberfläche des Objekts kommt: 1 wie es ist, 0 keines"
    ),
    "Fraction of the tile over which its borders blend: more hides the seam better but leaves a smaller tile": (
        "Bruchteil der Kachel, über den ihre Ränder verbunden werden: mehr verbirgt die Naht besser und lässt eine "
        "kleinere Kachel"
    ),
    "Frames of a sequence or video before and after each one to average it with, where they show the same surface": (
        "Bilder einer Sequenz oder eines Videos davor und dahinter, mit denen jedes gemittelt wird, wo sie dasselbe "
        "zeigen"
    ),
    "Free space around the object in the picture, as a fraction of the object's size": (
        "Freier Raum um das Objekt im Bild, als Bruchteil der Größe des Objekts"
    ),
    "From above": "Von oben",
    "From below": "Von unten",
    "From where the photo's camera is looked for. Pairs of points go before it": (
        "Von wo aus die Kamera des Fotos gesucht wird. Punktpaare gehen vor"
    ),
    "Graphics cards on Windows, where the installed onnxruntime has it": (
        "Grafikkarten unter Windows, wo das installierte onnxruntime es kann"
    ),
    "Green is down: Unreal Engine": "Grün ist unten: Unreal Engine",
    "Green is up: Blender, glTF, Unity, Godot": "Grün ist oben: Blender, glTF, Unity, Godot",
    "Hanging and falling cloth": "Hängender und fallender Stoff",
    "Height of the photo in pixels": "Höhe des Fotos in Pixeln",
    "Heights as the photo's camera sees them": "Höhen, wie die Kamera des Fotos sie sieht",
    "Heights on the object's UVs": "Höhen auf den UVs des Objekts",
    (
        "Broadest bumps that heights on UVs keep, as a fraction of the object's size: broader shapes are left "
        "to the mesh, because estimated normals err most there. 0 keeps all"
    ): (
        "Wie breit Wölbungen der Höhen auf UVs sein dürfen, als Bruchteil der Größe des Objekts: breitere bleiben dem "
        "Mesh überlassen, weil die Fehler geschätzter Normalen breit sind. 0 behält alle"
    ),
    "How far the aligned mesh's point is from the place in the photo, in pixels. -1: not aligned yet": (
        "Wie weit der Punkt des ausgerichteten Meshs von der Stelle im Foto entfernt ist, in Pixeln. -1: noch nicht "
        "ausgerichtet"
    ),
    "How far the cameras look down on the object, in degrees. 0: from the side, 90: from above": (
        "Wie weit die Kameras auf das Objekt hinabblicken, in Grad. 0: von der Seite, 90: von oben"
    ),
    "How far the lights and an orthographic camera stand from the object, in radii of the object": (
        "Wie weit die Lichter und eine orthografische Kamera vom Objekt entfernt stehen, in Radien des Objekts"
    ),
    (
        "Distance from the camera to the object, in the unit of a rig file with near lights. 0: as far as the "
        "rig's target, or by the surface"
    ): (
        "Wie weit das Objekt von der Kamera entfernt ist, in der Einheit einer Rig-Datei mit nahen Lichtern. 0: so "
        "weit wie das Ziel des Rigs, oder nach der Oberfläche"
    ),
    (
        "Mean distance from the camera to the visible surface, in the unit of the heights: it sets a perspective "
        "camera's scale, and where an orthographic camera's mesh stands. 0: as far as the target is in this scene"
    ): (
        "Wie weit das Objekt im Mittel von der Kamera entfernt ist, in der Einheit der Höhen: eine perspektivische "
        "Kamera nimmt daraus ihren Maßstab, für eine orthografische steht dort das Mesh. 0: so weit wie das Ziel in "
        "dieser Szene"
    ),
    "How far the outlines of mesh and photo are apart, in pixels. -1: not known": (
        "Wie weit die Umrisse von Mesh und Foto auseinanderliegen, in Pixeln. -1: nicht bekannt"
    ),
    "How large each light looks from the object, in degrees. Larger lights give softer shadows": (
        "Wie groß jedes Licht vom Objekt aus erscheint, in Grad. Größere Lichter werfen weichere Schatten"
    ),
    "How long it will still take, in words. Empty: not known yet": (
        "Wie lange es noch dauert, in Worten. Leer: noch nicht bekannt"
    ),
    "How many faces the mesh may have at most; they are smaller where the surface bends": (
        "Wie viele Flächen das Mesh haben darf; kleine, wo sich die Oberfläche biegt"
    ),
    (
        "How many half waves across the photo to remove as bends of the material and uneven light. 0: only "
        "the tilt of the photo"
    ): (
        "Wie viele halbe Wellen über das Foto als Biegungen des Materials und ungleiches Licht herausgenommen "
        "werden. 0: nur die Neigung des Fotos"
    ),
    "How many processes run at the same time on this machine. 0: one for each CPU core": (
        "Wie viele Prozesse auf diesem Rechner gleichzeitig arbeiten. 0: einer je Prozessorkern"
    ),
    "How many rigs stand around the object": "Wie viele Rigs um das Objekt stehen",
    "How many samples in a row show the same shape, each in another pose, light and material": (
        "Wie viele Beispiele hintereinander dieselbe Form zeigen, jedes in anderer Pose, anderem Licht und Material"
    ),
    "How many samples the folder will hold in total. A larger count continues where a smaller one stopped": (
        "Wie viele Beispiele der Ordner am Ende enthalten soll. Eine größere Anzahl setzt fort, wo eine kleinere "
        "aufhörte"
    ),
    "How many tiles wide and high the plane is that shows the material": (
        "Wie viele Kacheln breit und hoch die Ebene ist, die das Material zeigt"
    ),
    "How much is done, as a fraction": "Wie viel getan ist, als Bruchteil",
    "How many times light bounces between surfaces at most, drawn for each sample. 0: none": (
        "Wie oft Licht höchstens von Oberfläche zu Oberfläche geht, für jedes Beispiel neu gezogen. 0: gar nicht"
    ),
    (
        "How often the mesh is subdivided first: each makes four times as many faces, which take more of the relief's "
        "shape. But a low poly's facets show more in its shadows, as Cycles softens those of large faces. 0: its own "
        "vertices move, and the normal map shows the rest"
    ): (
        "Wie oft das Mesh zuerst unterteilt wird: jedes Mal viermal so viele Flächen, die mehr von der Form des "
        "Reliefs annehmen. Die Facetten eines Low-Poly-Meshs zeigen sich dann aber mehr in seinen Schatten, da Cycles "
        "die großer Flächen weicher macht. 0: seine eigenen Vertices bewegen sich, und die Normalmap zeigt den Rest"
    ),
    "How the camera that comes with the rig projects": "Wie die Kamera abbildet, die zum Rig gehört",
    "How the last run of each of its operators ended": "Wie der letzte Lauf jedes seiner Operatoren endete",
    "How the last run of each operator ended": "Wie der letzte Lauf jedes Operators endete",
    "How the material shows its relief in Blender": "Wie das Material sein Relief in Blender zeigt",
    "How the mesh is subdivided": "Wie das Mesh unterteilt wird",
    "How the photo's values encode light": "Wie die Werte des Fotos für Licht stehen",
    "How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet": (
        "Wie das Mesh des Photogrammetrie-Programms in Blender kam, damit Mesh und Kameras zusammenpassen"
    ),
    "How the viewport was shaded before, as JSON": "Wie das Ansichtsfenster vorher schattiert war, als JSON",
    "How well the mesh fits the photo, in words. Empty: not aligned": (
        "Wie gut das Mesh zum Foto passt, in Worten. Leer: nicht ausgerichtet"
    ),
    "The surface breaks where one object occludes another; takes several times as long": (
        "Sie bricht, wo eines vor dem anderen steht; dauert mehrmals so lange"
    ),
    "Ju et al. 2018: three intensities from each pixel, then equation 2": (
        "Ju et al. 2018: drei Intensitäten aus jedem Pixel, dann Gleichung 2"
    ),
    "Keep the bake's settings as a preset, or remove one; files and names are not kept": (
        "Die Einstellungen des Backens als Voreinstellung behalten oder eine entfernen; Dateien und Namen werden "
        "nicht behalten"
    ),
    "Keep the rig's settings as a preset, or remove one": (
        "Die Einstellungen des Rigs als Voreinstellung behalten oder eine entfernen"
    ),
    "Kinds of generated shapes, of which each sample shows one": (
        "Arten generierter Formen, von denen jedes Beispiel eine zeigt"
    ),
    "Let a white lamp swing around what the viewport shows, in place of the rigs' lights. Press again to end it": (
        "Eine weiße Lampe um das schwingen lassen, was das Ansichtsfenster zeigt, anstelle der Lichter der Rigs. "
        "Erneut drücken, um es zu beenden"
    ),
    (
        "Let the Python of this file, drivers and text blocks, run in the next render. Only for files whose maker "
        "you trust"
    ): (
        "Das Python dieser Datei, Treiber und Textblöcke, beim nächsten Rendern laufen lassen. Nur für Dateien, "
        "deren Ersteller vertrauenswürdig ist"
    ),
    "Light falls as on the relief; the surface itself stays flat": (
        "Licht fällt wie auf das Relief; die Oberfläche selbst bleibt flach"
    ),
    "Linear for float files and camera raw, sRGB for all others, unless the file says otherwise": (
        "Linear für Gleitkomma-Dateien und Kamera-RAW, sRGB für alle anderen, außer die Datei sagt etwas anderes"
    ),
    "Make a mesh of the surface, where the photo's camera saw it, with the photo's UVs": (
        "Ein Mesh der Oberfläche machen, wo die Kamera des Fotos sie sah, mit den UVs des Fotos"
    ),
    (
        "Make a node group of the baked texture, and of its heights where there are, to drag into other materials. "
        "The Asset Browser shows it. Press again after another bake or displacement"
    ): (
        "Eine Node-Gruppe aus der gebackenen Textur machen, und aus ihren Höhen, wo es welche gibt, um sie in andere "
        "Materialien zu ziehen. Der Asset-Browser zeigt sie. Nach weiterem Backen oder Verschieben erneut drücken"
    ),
    (
        "Make a seamless material of the photo, which shows cloth, leather or bark that lies flat and fills it. "
        "Writes normals, height, curvature and albedo, and shows the material on a plane of its true size"
    ): (
        "Ein nahtloses Material aus dem Foto machen, das Stoff, Leder oder Rinde zeigt, die flach liegen und es "
        "ausfüllen. Schreibt Normalen, Höhe, Krümmung und Albedo und zeigt das Material auf einer Ebene in wahrer "
        "Größe"
    ),
    "Make heights of the estimated normals: a file, a mesh where the camera saw the object, pictures of its shape": (
        "Höhen aus den geschätzten Normalen machen: eine Datei, ein Mesh, wo die Kamera das Objekt sah, Bilder "
        "seiner Form"
    ),
    (
        "Make one photo of three, each of them under one of the rig's lights alone, turned white. The object may not "
        "move between them. Each photo becomes a channel, so that paint does not mislead the estimate"
    ): (
        "Aus dreien ein Foto machen, jedes davon unter nur einem der Lichter des Rigs, auf Weiß gestellt. Das Objekt "
        "darf sich dazwischen nicht bewegen. Jedes Foto wird zu einem Kanal, damit Farbe die Schätzung nicht täuscht"
    ),
    "Make the baked texture's heights on the target's UVs and displace its surface by them": (
        "Die Höhen der gebackenen Textur auf den UVs des Ziels berechnen und seine Oberfläche danach verschieben"
    ),
    "Mark nothing; what is marked already stays so": "Nichts markieren; was markiert ist, bleibt es",
    (
        "Measured rig (.json or .lp) of photos that you open. A photo that was rendered in this scene is estimated "
        "with the rig that it was rendered with. Empty: the rig beside the photo when it was opened, else the rig in "
        "this scene"
    ): (
        "Gemessenes Rig (.json oder .lp) von Fotos, die geöffnet werden. Ein in dieser Szene gerendertes Foto wird "
        "mit dem Rig geschätzt, mit dem es gerendert wurde. Leer: das Rig, das beim Öffnen neben dem Foto lag, sonst "
        "das Rig dieser Szene"
    ),
    (
        "Mesh object that gets the texture. Empty: the active object. Photos that are rendered leave the target out "
        "where the detailed object is in its place"
    ): (
        "Mesh-Objekt, das die Textur bekommt. Leer: das aktive Objekt. Gerenderte Fotos lassen das Ziel weg, wo das "
        "detaillierte Objekt an seiner Stelle ist"
    ),
    (
        "Mesh that gives each pixel's distance to near lights (area and point lights). Empty: all is assumed to be "
        "as far as the rig's target"
    ): (
        "Mesh, das den Abstand jedes Pixels zu nahen Lichtern angibt (Flächen- und Punktlichter). Leer: alles gilt "
        "als so weit wie das Ziel des Rigs"
    ),
    "Mesh that was made of the normals and their heights": "Mesh, das aus den Normalen und ihren Höhen gemacht wurde",
    "Middle of the ball at its second place, in pixels from the photo's left edge": (
        "Mitte der Kugel an ihrem zweiten Ort, in Pixeln vom linken Rand des Fotos"
    ),
    "Middle of the ball at its second place, in pixels from the photo's top edge": (
        "Mitte der Kugel an ihrem zweiten Ort, in Pixeln vom oberen Rand des Fotos"
    ),
    "Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below": (
        "Mitte der Kugel, in Pixeln vom linken Rand des Fotos. Zählt nur mit einem Radius unten"
    ),
    "Middle of the ball, in pixels from the photo's top edge": "Mitte der Kugel, in Pixeln vom oberen Rand des Fotos",
    "NVIDIA graphics cards, where the installed onnxruntime has it": (
        "NVIDIA-Grafikkarten, wo das installierte onnxruntime es kann"
    ),
    "Name of the mesh object that gets the texture. Empty: the panel's target, else the active object": (
        "Name des Mesh-Objekts, das die Textur bekommt. Leer: das Ziel im Panel, sonst das aktive Objekt"
    ),
    "Name of the mesh object that gives each pixel's distance to near lights. Empty: the panel's": (
        "Name des Mesh-Objekts, das den Abstand jedes Pixels zu nahen Lichtern angibt. Leer: das des Panels"
    ),
    "Name of a camera object whose focal length and shift the photo's camera gets. Empty: the one in the panel, unless "
    "Lens (mm) is given": (
        "Name eines Kamera-Objekts, dessen Brennweite und Verschiebung die Kamera des Fotos bekommt. Leer: die im "
        "Panel, außer wenn Brennw. (mm) angegeben ist"
    ),
    "Name of the mesh object that the photo shows. Empty: the target of the bake, else the active one": (
        "Name des Mesh-Objekts, das das Foto zeigt. Leer: das Ziel des Backens, sonst das aktive"
    ),
    "Network in an .onnx file": "Netz in einer .onnx-Datei",
    "No perspective: every pixel looks in the same direction": (
        "Keine Perspektive: jedes Pixel blickt in dieselbe Richtung"
    ),
    (
        "Normal map (tangent space, same UVs) to add the detail to; <OBJECT>, <MATERIAL> and <UDIM> in its "
        "name stand for those of each texture; or a .json file that lists several maps. Empty: those in the "
        "materials"
    ): (
        "Normalmap (Tangentenraum, gleiche UVs), auf die das Detail kommt; <OBJECT>, <MATERIAL> und <UDIM> im Namen "
        "stehen für das, wovon jede Textur ist; oder eine .json-Datei, die mehrere auflistet. Leer: die in den "
        "Materialien"
    ),
    "Normal map in camera space": "Normalmap im Kameraraum",
    (
        "Normal map to write: .png, .tif or .exr; a folder for several photos, where frames that are already "
        "there are skipped. Empty: a name of its own in the output folder"
    ): (
        "Zu schreibende Normalmap: .png, .tif oder .exr; ein Ordner, wo es mehrere Fotos gibt: Bilder, die er schon "
        "enthält, werden nicht noch einmal gemacht. Leer: ein eigener Name im Ausgabeordner"
    ),
    "Leave flat normals": "Nichts: flache Normalen",
    "Number in the list, from 0, of the rig that the panel shows. Change it with mps.choose_rig": (
        "Nummer des Rigs in der Liste, ab 0, das das Panel zeigt. Zu ändern mit mps.choose_rig"
    ),
    "Number of the first frame of normals, where they are a sequence": (
        "Nummer des ersten Bilds der Normalen, wo sie eine Sequenz sind"
    ),
    "Number of the last frame of normals, where they are a sequence": (
        "Nummer des letzten Bilds der Normalen, wo sie eine Sequenz sind"
    ),
    "Number of the pair in the photo's list, from 0": "Nummer des Paars in der Liste des Fotos, ab 0",
    "Number of the rig in the scene's list, from 0": "Nummer des Rigs in der Liste der Szene, ab 0",
    "One for each material; its name goes into the file's name": (
        "Eine für jedes Material; dessen Name kommt in den Dateinamen"
    ),
    "One for each object; its name goes into the file's name": (
        "Eine für jedes Objekt; dessen Name kommt in den Dateinamen"
    ),
    "One, at the pixel's centre": "Einer in der Mitte des Pixels",
    "One of the rig's three lights": "Eines der drei Lichter des Rigs",
    "One surface without gaps: for one object, reliefs, cloth": (
        "Eine Oberfläche ohne Lücken: für ein Objekt, Reliefs, Stoff"
    ),
    (
        "Open a captured photo (PNG, TIFF, JPEG, OpenEXR, camera raw), all frames of a sequence, or a video. Files "
        "NAME.rig.json and NAME.camera.json beside it are read"
    ): (
        "Ein aufgenommenes Foto öffnen (PNG, TIFF, JPEG, OpenEXR, Kamera-RAW), alle Bilder einer Sequenz oder ein "
        "Video. Dateien NAME.rig.json und NAME.camera.json daneben werden gelesen"
    ),
    (
        "Open the photo's mask in an Image Editor to paint on it: white adds to the object, black takes away. The "
        "next estimate uses it as it is painted then. Press again to see what it comes to"
    ): (
        "Die Maske des Fotos in einem Bildeditor öffnen, um darauf zu malen: Weiß fügt zum Objekt hinzu, Schwarz "
        "nimmt weg. Die nächste Schätzung benutzt sie, wie sie dann gemalt ist. Erneut drücken, um zu sehen, was "
        "daraus wird"
    ),
    "OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder": (
        "Zu schreibende OpenEXR-Datei oder der Ordner einer Animation. Leer: ein eigener Name im Ausgabeordner"
    ),
    "OpenEXR file to write. Empty: a name of its own in the output folder": (
        "Zu schreibende OpenEXR-Datei. Leer: ein eigener Name im Ausgabeordner"
    ),
    "Operator whose work runs. Empty: none": "Operator, dessen Arbeit läuft. Leer: keiner",
    "PNG and TIFF": "PNG und TIFF",
    "Parallel light: as bright and from the same direction everywhere on the object": (
        "Paralleles Licht: überall auf dem Objekt gleich hell und aus derselben Richtung"
    ),
    "Photo of a matt grey ball under the red, green and blue light at once": (
        "Foto einer matten grauen Kugel unter rotem, grünem und blauem Licht zugleich"
    ),
    "Photo of a mirror ball where the object stands, under the red, green and blue light at once": (
        "Foto einer Spiegelkugel an der Stelle des Objekts, unter rotem, grünem und blauem Licht zugleich"
    ),
    (
        "Photo of an even white card in the object's place, to correct vignetting and uneven light; several "
        "(a folder or pattern) are averaged; not for near lights"
    ): (
        "Foto einer gleichmäßig weißen Karte an der Stelle des Objekts, das Objektiv und Lichter ausgleicht; ein "
        "Ordner oder Muster von mehreren wird gemittelt; nicht zusammen mit nahen Lichtern"
    ),
    "Photo of the object at rest under the rig's first light alone, turned white: the red channel": (
        "Foto des ruhenden Objekts nur unter dem ersten Licht des Rigs, auf Weiß gestellt: der rote Kanal"
    ),
    (
        "Photo of the same ball at another place. With two places the lights' positions are found, not only their "
        "directions. Needs the lens"
    ): (
        "Foto derselben Kugel an einem anderen Ort. Mit zwei Orten werden die Positionen der Lichter gefunden, nicht "
        "nur ihre Richtungen. Braucht das Objektiv"
    ),
    "Photo of the same pose under the rig's second light alone, turned white: the green channel": (
        "Foto derselben Pose nur unter dem zweiten Licht des Rigs, auf Weiß gestellt: der grüne Kanal"
    ),
    "Photo of the same pose under the rig's third light alone, turned white: the blue channel": (
        "Foto derselben Pose nur unter dem dritten Licht des Rigs, auf Weiß gestellt: der blaue Kanal"
    ),
    "Photo of the scene without the object, under the same lights": (
        "Foto der Szene ohne das Objekt, unter denselben Lichtern"
    ),
    "Photo under red, green and blue light": "Foto unter rotem, grünem und blauem Licht",
    "Photo with the three lights off, to subtract; several (a folder or pattern) are averaged": (
        "Foto mit ausgeschalteten Lichtern, das abgezogen wird; ein Ordner oder Muster von mehreren wird gemittelt"
    ),
    "Curvature map: edges are bright, creases dark": "Bild der Kanten, hell, und der Falten, dunkel",
    "Ambient occlusion map: white where the surface is fully open to light": (
        "Bild, wie offen die Oberfläche ist, Ambient Occlusion: weiß, wo alles Licht hinkommt"
    ),
    "Image of the surface under a white light, with the ambient occlusion if that is made": (
        "Bild der Oberfläche unter weißem Licht, schattiert durch die Ambient Occlusion, wo diese gemacht wird"
    ),
    "Picture that is white where the object is and black elsewhere": (
        "Bild, das weiß ist, wo das Objekt ist, und sonst schwarz"
    ),
    "Pixels brighter than this fraction of the photo's brightest are the object": (
        "Pixel, die heller sind als dieser Bruchteil des hellsten im Foto, sind das Objekt"
    ),
    "Pixels by which the texture extends beyond the UV islands": (
        "Pixel, um die die Textur über die Ränder der UV-Inseln hinaus fortgesetzt wird"
    ),
    "Pixels to leave out at the photo's bottom": "Pixel, die unten am Foto wegfallen",
    "Pixels to leave out at the photo's left edge": "Pixel, die am linken Rand des Fotos wegfallen",
    "Pixels to leave out at the photo's right edge": "Pixel, die am rechten Rand des Fotos wegfallen",
    "Pixels to leave out at the photo's top": "Pixel, die oben am Foto wegfallen",
    "Place in the photo in pixels from its top left corner": "Stelle im Foto in Pixeln von seiner oberen linken Ecke",
    "Places in the photo and on the mesh that are the same": "Stellen im Foto und auf dem Mesh, die dieselben sind",
    "Points on the surface that each pixel averages; more take longer but smooth jagged edges": (
        "Punkte der Oberfläche, deren Mittel jedes Pixel ist; mehr dauern länger und mindern Treppenstufen"
    ),
    "Radius of the ball's outline at its second place, in pixels. Needed where the first one is given": (
        "Radius des Kugelumrisses an ihrem zweiten Ort, in Pixeln. Nötig, wo der erste angegeben ist"
    ),
    "Radius of the ball's outline in pixels. 0: the ball is looked for": (
        "Radius des Kugelumrisses in Pixeln. 0: die Kugel wird gesucht"
    ),
    (
        "Radius of the ball, in the unit for the lights' positions, best that of the mesh. Needed where "
        "lights have positions, for a grey ball too"
    ): (
        "Radius der Kugel in der Einheit, in der Positionen gewünscht sind: am besten der des Meshs. Er zählt, wo "
        "Lichter Positionen haben, auch für eine graue Kugel"
    ),
    "Remove the chosen rig with its lights and its camera; its photo and normals stay as files and images": (
        "Das gewählte Rig mit seinen Lichtern und seiner Kamera entfernen; sein Foto und seine Normalen bleiben als "
        "Dateien und Bilder"
    ),
    "Remove the rig's lights, camera and target": "Lichter, Kamera und Ziel des Rigs entfernen",
    "Remove this pair of points": "Dieses Punktpaar entfernen",
    (
        "Render the object with Cycles, lit by the rig's red, green and blue light alone, beside the live window. "
        "Other lights and the world are off. The scene is rendered as it is now and stays as it is. The rig and the "
        "camera, as they stand, are written beside the photo"
    ): (
        "Das Objekt mit Cycles rendern, nur vom roten, grünen und blauen Licht des Rigs beleuchtet, neben dem "
        "lebendigen Fenster. Andere Lichter und die Welt sind aus. Die Szene wird gerendert, wie sie jetzt ist, und "
        "bleibt so. Rig und Kamera, wie sie stehen, werden neben das Foto geschrieben"
    ),
    (
        "Render the true normals of the photo's view, as an OpenEXR with Blender's Normal pass, to compare with. The "
        "camera is written beside the file"
    ): (
        "Die wahren Normalen der Ansicht des Fotos rendern, als OpenEXR mit Blenders Normal-Pass, zum Vergleichen. "
        "Die Kamera wird neben die Datei geschrieben"
    ),
    (
        "Render training data into a folder, with several Blenders beside this one. What the folder holds already is "
        "not rendered again: after a stop, run it again and it goes on"
    ): (
        "Trainingsdaten in einen Ordner rendern, mit mehreren Blendern neben diesem. Was der Ordner schon enthält, "
        "wird nicht noch einmal gerendert: nach einem Halt erneut starten, und es geht weiter"
    ),
    "Rig file to write (.json). Empty: a name of its own in the output folder": (
        "Zu schreibende Rig-Datei (.json). Leer: ein eigener Name im Ausgabeordner"
    ),
    "Say whether the photo is exposed and focused well, and what its lights reach, before it is used": (
        "Sagen, ob das Foto gut belichtet und scharf ist und was seine Lichter erreichen, bevor es benutzt wird"
    ),
    (
        "Second photo of the same pose under white light (the three lights turned white), which shows the "
        "colour of the surface. Photos of one light each (a folder or pattern) are added up. For one still "
        "photo only"
    ): (
        "Zweites Foto derselben Pose unter weißem Licht: die drei Lichter auf Weiß gestellt. Es zeigt die Farbe der "
        "Oberfläche. Ein Ordner oder Muster mit einem Foto je Licht wird addiert. Nur für ein Standfoto"
    ),
    (
        "See all steps in a new scene: an object, its photo under three coloured lights, the normals estimated from "
        "it, and a low-poly copy that uses them. Takes seconds to half a minute and changes nothing of yours"
    ): (
        "Alle Schritte in einer neuen Szene sehen: ein Objekt, sein Foto unter drei farbigen Lichtern, die daraus "
        "geschätzten Normalen und eine Low-Poly-Kopie, die sie trägt. Dauert Sekunden bis eine halbe Minute und "
        "ändert nichts Eigenes"
    ),
    (
        "See the scene in this viewport as the camera sees it that took the photo, in the photo's frame. The scene's "
        "resolution is the photo's meanwhile. Press again, or turn the view, to leave it"
    ): (
        "Die Szene in diesem Ansichtsfenster sehen, wie die Kamera sie sieht, die das Foto aufgenommen hat, im "
        "Rahmen des Fotos. Die Auflösung der Szene ist so lange die des Fotos. Erneut drücken oder die Ansicht "
        "drehen, um es zu verlassen"
    ),
    "Several objects beside each other on a ground": "Mehrere Objekte nebeneinander auf einem Boden",
    (
        "Shade the displaced surface by the baked normals, subdivided as a texture in object space: the relief shows "
        "once, with what is finer than the mesh. Off, for objects that bend: by the displaced surface alone"
    ): (
        "Die verschobene Oberfläche mit den gebackenen Normalen schattieren, unterteilt als Textur im Objektraum: das "
        "Relief erscheint einmal, mit dem, was feiner ist als das Mesh. Aus, für Objekte, die sich biegen: nur durch "
        "die verschobene Oberfläche"
    ),
    "Shapes made up from the seed: nothing else is needed": (
        "Formen, aus dem Startwert erdacht: sonst wird nichts gebraucht"
    ),
    (
        "Show on the objects what the views saw: green there, orange where it is filled, red elsewhere. The objects "
        "and their materials stay as they are: copies that no render shows stand over them. Press again to end it"
    ): (
        "Auf den Objekten zeigen, was die Ansichten sahen: grün dort, orange, wo gefüllt ist, sonst rot. Die Objekte "
        "und ihre Materialien bleiben, wie sie sind: darüber stehen Kopien, die kein Render zeigt. Erneut drücken, "
        "um es zu beenden"
    ),
    'Show the tab "MPS Training" in the sidebar of the 3D viewport, which renders training data': (
        'Den Reiter "MPS Training" in der Seitenleiste des 3D-Ansichtsfensters zeigen, der Trainingsdaten rendert'
    ),
    "Show what the three lights reach while you move them, the camera or the object. Press again to leave it": (
        "Zeigen, was die drei Lichter erreichen, während sie, die Kamera oder das Objekt bewegt werden. Erneut "
        "drücken, um es zu verlassen"
    ),
    "Show which pixels of the photo count as the object, before they are used. The mask is written as a file, too": (
        "Zeigen, welche Pixel des Fotos als Objekt zählen, bevor sie benutzt werden. Die Maske wird auch als Datei "
        "geschrieben"
    ),
    "Sixteen per pixel: takes about sixteen times as long": "Sechzehn je Pixel: etwa sechzehnmal so lange",
    "Size, depth and seam of the material that was made": "Größe, Tiefe und Naht des gemachten Materials",
    "Slabs with a relief": "Platten mit einem Relief",
    "Some of the samples": "Einige der Beispiele",
    "Stop what is running; nothing half-written is left": "Anhalten, was läuft; nichts halb Geschriebenes bleibt",
    "TIFF and OpenEXR": "TIFF und OpenEXR",
    "Table of what was found: lines of cells with | between them": (
        "Tabelle dessen, was gefunden wurde: Zeilen mit Zellen und | dazwischen"
    ),
    (
        "Take a photo of each frame of the scene, from its first to its last, into a folder. Lights and camera "
        "should move together if they move: those of the first frame count for all"
    ): (
        "Von jedem Bild der Szene, vom ersten bis zum letzten, ein Foto in einen Ordner aufnehmen. Lichter und "
        "Kamera sollten sich zusammen bewegen, falls sie es tun: die des ersten Bilds gelten für alle"
    ),
    (
        "Take large shapes from the object and only detail from the photos, whatever else the estimates say: "
        "seams between views vanish"
    ): (
        "Große Formen vom Objekt nehmen und nur das Detail von den Fotos, was auch immer die Schätzungen sonst "
        "sagen: Nähte zwischen Ansichten verschwinden"
    ),
    "Take the noise from each light's picture with OpenImageDenoise, where light goes between surfaces": (
        "Das Rauschen im Bild jedes Lichts mit OpenImageDenoise entfernen, wo Licht zwischen Oberflächen geht"
    ),
    "Dismiss this message; you can run the step again": "Diese Meldung ausblenden; der Schritt kann erneut laufen",
    (
        "Texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for each "
        "tile, material or object; a folder for a sequence, or to take the name from a preset. Empty: in the "
        "output folder"
    ): (
        "Zu schreibende Textur: .png, .tif oder .exr; mit <UDIM>, <MATERIAL> oder <OBJECT> im Namen eine für jede "
        "Kachel, jedes Material oder Objekt; ein Ordner für eine Sequenz oder für den Namen der Voreinstellung. "
        "Leer: im Ausgabeordner"
    ),
    "The 3D viewport shows the mesh about as the photo does": (
        "Das 3D-Ansichtsfenster zeigt das Mesh ungefähr wie das Foto"
    ),
    "The angles between the normals and the true ones": "Die Winkel zwischen den Normalen und den wahren",
    "The baked normal texture": "Die gebackene Normalentextur",
    "The baseline for flat, matt cloth, leather or plaster of one colour: each channel divided by its mean": (
        "Der Vergleichsmaßstab für flachen, matten Stoff, Leder oder Putz von einer Farbe: jeder Kanal durch sein "
        "Mittel geteilt"
    ),
    "The baseline, at once: a matt surface of one grey (equation 2 of the paper)": (
        "Der Vergleichsmaßstab, sofort: eine matte Oberfläche von einem Grau (Gleichung 2 der Veröffentlichung)"
    ),
    "Only the camera moved; a rig file gives directions along the mesh's axes, or positions in its world": (
        "Die Kamera ging herum; eine Rig-Datei hat Richtungen entlang der Achsen des Meshs oder Positionen in seiner "
        "Welt"
    ),
    "The cluster's address need not be tls://. Whoever is in its network may run code on this machine": (
        "Die Adresse des Verbunds muss nicht tls:// sein. Wer in ihrem Netzwerk ist, kann Code auf diesem Rechner "
        "ausführen"
    ),
    "The copies that show the coverage, while it is shown": (
        "Die Kopien, die die Abdeckung zeigen, solange sie gezeigt wird"
    ),
    "The default in one pass: a sixth to half of the time, a little less accurate": (
        "Die Vorgabe mit einem Durchlauf: ein Sechstel bis die Hälfte der Zeit, etwas ungenauer"
    ),
    "The default: one network from coarse to fine, with equation 2 inside, that tells how sure it is": (
        "Die Vorgabe: ein Netz von grob nach fein, mit Gleichung 2 darin, das sagt, wie sicher es ist"
    ),
    "Extend the islands by the margin": "Die Inseln werden um den Rand fortgesetzt",
    "The lamp, while it is there": "Die Lampe, solange sie da ist",
    "35 mm equivalent focal length of the lens, in millimetres. 0: that of the photo; estimated too where that is 0": (
        "Kleinbildäquivalente Brennweite des Objektivs in Millimetern. 0: die des Fotos; wo sie 0 ist, wird sie mit "
        "gefunden"
    ),
    "The lights are fixed to the camera, or the object stood on a turntable": (
        "Die Lichter sind an der Kamera befestigt, oder das Objekt stand auf einem Drehteller"
    ),
    "The map was made from the same object": "Die Map wurde von demselben Objekt gemacht",
    "The map was sculpted or painted": "Die Map wurde modelliert oder gemalt",
    "The mask, drawn over the photo": "Die Maske, über das Foto gezeichnet",
    "The material, repeated": "Das Material, wiederholt",
    "The materials that use the texture": "Die Materialien, die die Textur verwenden",
    "The mesh becomes round, edges with a crease apart: for one that is made for it": (
        "Das Mesh wird rund, Kanten mit Falte ausgenommen: für eines, das dafür gemacht ist"
    ),
    "The mesh keeps its shape, its smooth shading and its sharp edges": (
        "Das Mesh behält seine Form, seine glatte Schattierung und seine scharfen Kanten"
    ),
    "The mesh objects that are selected in this scene": "Die Mesh-Objekte, die in dieser Szene ausgewählt sind",
    "The meshes in a folder, alone and several together: OBJ, PLY, STL, OFF or glTF files": (
        "Die Meshs in einem Ordner, einzeln und mehrere zusammen: OBJ-, PLY-, STL-, OFF- oder glTF-Dateien"
    ),
    "The normals of that photo": "Die Normalen dieses Fotos",
    "The objects that use the texture": "Die Objekte, die die Textur verwenden",
    "The paper's network, patch by patch: only for rigs like the paper's": (
        "Das Netz der Veröffentlichung, Stück für Stück: nur für Aufbauten wie dort"
    ),
    "The photo is a numbered frame, and all frames that are numbered like it are meant": (
        "Das Foto ist ein nummeriertes Einzelbild, und alle ebenso nummerierten Bilder sind gemeint"
    ),
    "The photo that these normals were estimated from": "Das Foto, aus dem diese Normalen geschätzt wurden",
    "The photo that was taken with it": "Das Foto, das mit ihm aufgenommen wurde",
    "The photo under red, green and blue light": "Das Foto unter rotem, grünem und blauem Licht",
    "The photo with the outlines of mask and mesh": "Das Foto mit den Umrissen von Maske und Mesh",
    (
        "The photo's alpha if it has one, as rendered photos do; else the object if it stands out clearly; else the "
        "whole photo"
    ): (
        "Der Alphakanal des Fotos, falls es einen hat, wie gerenderte Fotos; sonst das Objekt, wenn es sich deutlich "
        "abhebt; sonst das ganze Foto"
    ),
    "The photo's camera, else the scene's, stands about where the photo was taken": (
        "Die Kamera des Fotos, sonst die der Szene, steht ungefähr dort, wo das Foto aufgenommen wurde"
    ),
    "The photo, bright where it is the object and dark elsewhere, to be painted on": (
        "Das Foto, hell, wo es das Objekt ist, und sonst dunkel, zum Bemalen"
    ),
    "The plane that shows the material": "Die Ebene, die das Material zeigt",
    "The rig's red, green and blue light, in this order": (
        "Rotes, grünes und blaues Licht des Rigs, in dieser Reihenfolge"
    ),
    "The rig's settings and objects": "Einstellungen und Objekte des Rigs",
    "The rigs' lights that it hid": "Die Lichter der Rigs, die sie verbarg",
    "The same place on the mesh, in units of the world": "Dieselbe Stelle auf dem Mesh, in Einheiten der Welt",
    "The scene's rigs, where it has several": "Die Rigs der Szene, wo sie mehrere hat",
    "The side of the object that the camera sees": "Die Seite des Objekts, die die Kamera sieht",
    "The surface itself is displaced by the true height in Cycles, and what is finer than its faces is a bump": (
        "Die Oberfläche selbst wird in Cycles um die wahre Höhe verschoben, und was feiner ist als ihre Flächen, ist "
        "Bump"
    ),
    "The surface's colour": "Die Farbe der Oberfläche",
    "The target alone": "Nur das Ziel",
    "The whole photo: a wall or cloth that fills it": "Das ganze Foto: eine Wand oder ein Tuch, das es ausfüllt",
    "Fill the whole texture smoothly": "Die ganze Textur wird weich gefüllt",
    "This address need not be tls://. Whoever is in its network may run code on this machine": (
        "Diese Adresse muss nicht tls:// sein. Wer in ihrem Netzwerk ist, kann Code auf diesem Rechner ausführen"
    ),
    "To the object: for objects that do not bend": "Auf das Objekt: für Objekte, die sich nicht biegen",
    "To the surface, by MikkTSpace: the object may move, bend and be reused": (
        "Auf die Oberfläche, nach MikkTSpace: das Objekt darf sich bewegen, biegen und wiederverwendet werden"
    ),
    "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do by default": (
        "Von Y oben nach Z oben gedreht, wie es Blenders Importer von OBJ und glTF von sich aus tun"
    ),
    "Twice the value is twice the light": "Doppelter Wert ist doppeltes Licht",
    "UV map of the target to bake onto. Empty: the one that is active for rendering": (
        "UV-Map des Ziels, auf die gebacken wird. Leer: die zum Rendern aktive"
    ),
    "Viewport that shows the coverage, and how it was shaded before, as JSON": (
        "Ansichtsfenster, das die Abdeckung zeigt, und wie es vorher schattiert war, als JSON"
    ),
    "Views all around the mesh are tried; the best one counts": (
        "Ansichten rund um das Mesh werden ausprobiert; die beste zählt"
    ),
    "What Blender's Asset Browser shows of the result": "Was Blenders Asset-Browser vom Ergebnis zeigt",
    (
        "Cameras from photogrammetry: a COLMAP folder, Metashape's .xml, Meshroom's .sfm or a folder of "
        "NAME.camera.json. Empty: this scene's cameras, each with its photo as background image"
    ): (
        "Was ein Photogrammetrie-Programm geschrieben hat: ein COLMAP-Ordner, die .xml von Metashape oder die .sfm "
        "von Meshroom; oder ein Ordner mit NAME.camera.json. Leer: die Kameras dieser Szene, jede mit ihrem Foto als "
        "Hintergrundbild"
    ),
    "What has a texture of its own": "Was eine eigene Textur bekommt",
    "What is being done": "Was gerade getan wird",
    "What is bright in the picture that Paint Mask opens, as it is painted now": (
        "Was in dem Bild hell ist, das Maske malen öffnet, so wie es dann gemalt ist"
    ),
    "What is smaller than about twice this fraction of the object's size is detail, and taken from the photos": (
        "Was kleiner ist als etwa das Doppelte dieses Bruchteils der Größe des Objekts, ist Detail und kommt von den "
        "Fotos"
    ),
    "What kind of lights the rig has": "Welche Art von Lichtern das Rig hat",
    "How to fill the texture beyond the UV islands, which mipmaps blend into the islands' borders": (
        "Was jenseits der Ränder der UV-Inseln liegt, wohin eine verkleinerte Textur reicht"
    ),
    "What moves the surface": "Was die Oberfläche bewegt",
    "What networks run on. The Lambertian baseline always runs on the CPU": (
        "Worauf Netze rechnen. Der Lambert-Vergleichsmaßstab rechnet immer auf der CPU"
    ),
    "What stands out from a dark or plain background, which takes up most of the photo's border": (
        "Was sich von einem dunklen oder schlichten Hintergrund abhebt, der den größten Teil des Fotorands einnimmt"
    ),
    "What the last run had to say, a line each": "Was der letzte Lauf zu sagen hatte, je eine Zeile",
    "Whether the lights moved with the camera or stood still in the world": (
        "Womit die Lichter gingen, während die Fotos aufgenommen wurden"
    ),
    (
        "What the photo's whole width measures on the material, in this scene's unit. 0: by the orthographic camera "
        "that the photo was rendered with"
    ): (
        "Wie viel die ganze Breite des Fotos auf dem Material misst, in der Einheit dieser Szene. 0: nach der "
        "orthografischen Kamera, mit der das Foto gerendert wurde"
    ),
    "Seed of the random draws: the same seed gives the same samples": (
        "Woraus die Beispiele gezogen werden: derselbe Startwert ergibt dieselben Beispiele"
    ),
    "What the samples show": "Was die Beispiele zeigen",
    "What the texture's normals are relative to": "Worauf sich die Normalen der Textur beziehen",
    "Model that estimates the normals, by name or as an .onnx file": (
        "Was das Foto in Normalen verwandelt: eines der Modelle nach seinem Namen oder eine .onnx-Datei"
    ),
    "What was found, drawn over the photo": "Was gefunden wurde, über das Foto gezeichnet",
    "What you change in the steps' settings is what the next new file begins with, files and names apart": (
        "Was in den Einstellungen der Schritte geändert wird, damit beginnt die nächste neue Datei, Dateien und "
        "Namen ausgenommen"
    ),
    "Where a mask picture is white": "Wo ein Maskenbild weiß ist",
    (
        "Where photos, normal maps and textures go. Empty: beside the saved .blend file, else Blender's temporary "
        "folder"
    ): (
        "Wohin Fotos, Normalmaps und Texturen kommen. Leer: neben die gespeicherte .blend-Datei, sonst in Blenders "
        "temporären Ordner"
    ),
    "Where it hid them": "Wo sie sie verbarg",
    "Where the photo comes from, and so which settings the panel shows": (
        "Woher das Foto kommt und damit, welche Einstellungen das Panel zeigt"
    ),
    "Where the photo differs from one of the scene without the object": (
        "Wo sich das Foto von einem der Szene ohne das Objekt unterscheidet"
    ),
    "Where the photo is brighter than a threshold": "Wo das Foto heller ist als ein Schwellwert",
    "Where the photo is opaque": "Wo das Foto deckend ist",
    "Whether the mesh fits the photo too poorly to bake with": (
        "Ob das Mesh zu schlecht zum Foto passt, um damit zu backen"
    ),
    "Whether the photos already show the existing map's relief, which is then not added twice": (
        "Ob die Fotos das Relief der vorhandenen Map auch zeigen; dann wird es nicht noch einmal addiert"
    ),
    "Whether the surface may break": "Ob die Oberfläche brechen darf",
    "Whether to stop the work": "Ob die Arbeit anhalten soll",
    "Which objects are baked onto, in one go: they hide one another from the cameras": (
        "Auf welche Objekte in einem Zug gebacken wird: sie verdecken einander vor den Kameras"
    ),
    "Which of this texture's texels some view saw": "Welche Texel dieser Textur irgendeine Ansicht sah",
    "Which pixels of the photo are the object": "Welche Pixel des Fotos das Objekt sind",
    "Which way the green channel of the existing map points": "Wohin der grüne Kanal der vorhandenen Map zeigt",
    "Which way the texture's green channel points": "Wohin der grüne Kanal der Textur zeigt",
    'Whose message to take away: "estimate" for mps.estimate': (
        'Wessen Meldung auszublenden ist: "estimate" für mps.estimate'
    ),
    "Why the last run failed and how to mend it. Empty: it did not": (
        "Warum der letzte Lauf fehlschlug und wie es zu beheben ist. Leer: er schlug nicht fehl"
    ),
    "Width and height of a sample in pixels": "Breite und Höhe eines Beispiels in Pixeln",
    "Width and height of the demo's photo in pixels": "Breite und Höhe des Demo-Fotos in Pixeln",
    "Width and height of the demo's texture in pixels": "Breite und Höhe der Demo-Textur in Pixeln",
    "Width and height of the textures in pixels. 0: the photo's own resolution": (
        "Breite und Höhe der Bilder in Pixeln. 0: die Pixel, die das Foto dort hat"
    ),
    (
        "What lit the white photo: the rig's three lights turned white, or one lamp in this direction in degrees. "
        "Empty: the rig's three lights"
    ): (
        "Was das Weißlichtfoto beleuchtet hat: die drei Lichter des Rigs auf Weiß gestellt, oder eine Lampe in dieser "
        "Richtung in Grad. Leer: die drei Lichter des Rigs"
    ),
    "Width and height of the texture in pixels": "Breite und Höhe der Textur in Pixeln",
    "Width of the photo in pixels": "Breite des Fotos in Pixeln",
    "With forward Y and up Z, as Blender's importer of PLY does": (
        "Mit Y vorne und Z oben, wie es Blenders Importer von PLY tut"
    ),
    "Work with this rig, its photo and its estimate": "Mit diesem Rig, seinem Foto und seiner Schätzung arbeiten",
    "Works everywhere": "Funktioniert überall",
    "Write an HTML page that shows which views cover what and how much they disagree": (
        "Eine HTML-Seite schreiben, die zeigt, welche Ansichten was abdecken und wie weit sie sich widersprechen"
    ),
    "Written as NAME_Normal.png, 8 bits per channel": "Geschrieben als NAME_Normal.png, 8 Bit je Kanal",
    "Written as NAME_normal.png, 16 bits per channel": "Geschrieben als NAME_normal.png, 16 Bit je Kanal",
    "Written as NAME_normal.png, 8 bits per channel": "Geschrieben als NAME_normal.png, 8 Bit je Kanal",
    "Written as T_NAME_N.png, 16 bits per channel": "Geschrieben als T_NAME_N.png, 16 Bit je Kanal",
    "Written as name_normal.png, 8 bits per channel": "Geschrieben als name_normal.png, 8 Bit je Kanal",
    "You took the photo of a real object under real lights": (
        "Das Foto eines echten Objekts unter echten Lichtern wurde aufgenommen"
    ),
}
