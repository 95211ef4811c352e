"""Tooltips in Simplified Chinese, by the English ones in one line."""

TIPS = {
    "16 bits, 32 in OpenEXR": "16 位，OpenEXR 为 32 位",
    "16-bit PNG": "16 位 PNG",
    "16-bit TIFF": "16 位 TIFF",
    "32-bit float OpenEXR": "32 位浮点 OpenEXR",
    (
        "A Displace modifier: a mesh that can be seen in the viewport, sculpted and exported. What is finer than the "
        "mesh is lost"
    ): ("置换修改器：得到可在视图中查看、雕刻和导出的网格。比网格更细的部分会丢失"),
    "A Displacement node: when rendering. What is finer than the mesh becomes bumps, so that all detail is there": (
        "置换节点：在渲染时生效。比网格更细的部分成为凹凸，因此保留全部细节"
    ),
    "A network in an .onnx file": ".onnx 文件中的网络",
    "A texture for each unit square that the UVs lie in, numbered 1001, 1002 and so on. Size is that of each": (
        "UV 所在的每个单位方格一张纹理，编号 1001、1002 等。尺寸指每一张的尺寸"
    ),
    (
        "Add rigs in a ring around the selected objects, with the settings of the rig; those that are there stay. "
        "The first one looks along +Y, as Blender's front view"
    ): ("按灯架的设置，在所选物体周围添加一圈灯架；已有的保留。第一个沿 +Y 方向看，与 Blender 的前视图相同"),
    "Add the detail to the normal maps that the objects use, which stay as they are beneath": (
        "将细节叠加到物体已有的法线贴图上，下层贴图保持原样"
    ),
    "Add three coloured lights and a camera around the selected objects, in place of an earlier rig": (
        "在所选物体周围添加三盏彩色灯光和一台摄像机，取代先前的灯架"
    ),
    ("Address of a Dask scheduler whose machines render training data, such as tls://host:8786. Empty: this machine"): (
        "用其机器渲染训练数据的 Dask 调度器地址，例如 tls://host:8786。留空：本机"
    ),
    (
        "Address of a Dask scheduler whose machines render, such as tls://host:8786. Empty: that of the preferences, "
        "where they have one"
    ): ("用其机器渲染的 Dask 调度器地址，例如 tls://host:8786。留空：偏好设置中的地址（若有）"),
    "All formats": "所有格式",
    "All selected mesh objects": "所有选中的网格物体",
    "All that is baked shares one texture; the UVs of several objects must not overlap": (
        "所有烘焙内容共用一张纹理；多个物体的 UV 不得重叠"
    ),
    "Along +X, as Blender's left view": "沿 +X 方向，与 Blender 的左视图相同",
    "Along +Y, as Blender's front view": "沿 +Y 方向，与 Blender 的前视图相同",
    "Along -X": "沿 -X 方向",
    "Along -Y": "沿 -Y 方向",
    "Also write a map of how far each normal can be trusted, for one photo": (
        "同时写出每条法线的可信程度，每张照片一幅图"
    ),
    "Also write the surface's colour without light and shadow on it, made from the photo under white light": (
        "同时写出没有光影的表面颜色，由白光下的照片得出"
    ),
    "Make the albedo grey, for lights of unknown strengths": "在灯光强度未知时，使用没有颜色的反照率",
    "Angle in degrees between each light and the line from the object to the camera": (
        "每盏灯与物体到摄像机连线之间的角度（度）"
    ),
    "Apple computers, where the installed onnxruntime has it": "Apple 电脑，需所安装的 onnxruntime 支持",
    "As a lens sees it": "如同镜头所见",
    "As for a screen": "与屏幕显示相同",
    "As set below; what another preset has set stays until it is changed": "按下方设置；其他预设所设的值保留到更改为止",
    "As the 3D viewport looks at it now": "按 3D 视图当前的视角",
    (
        "Average the default network's answers on the scene turned and mirrored, and look twice at many colours: "
        "better, at half to a sixth of its speed. For stills; frames of a sequence or video get one pass"
    ): (
        "对旋转和镜像后的场景取默认网络结果的平均，颜色多时再看一遍：更好，速度为二分之一到六分之一。"
        "用于静态照片；序列或视频的帧只算一次"
    ),
    "Bake the estimated normals into a texture on the target's UV map and give its material a Normal Map node": (
        "将估计的法线烘焙到目标 UV 贴图的纹理上，并为其材质添加法线贴图节点"
    ),
    (
        "Bake the normals of all rigs of this scene together, each as its own camera saw them. Off: those of the "
        "chosen rig alone"
    ): ("将此场景所有灯架的法线一起烘焙，各按其摄像机所见。关闭：仅所选灯架的法线"),
    "Begin another rig in this scene, with a photo and an estimate of its own; the rigs that are there stay": (
        "在此场景中新建另一个灯架，有自己的照片和估计；已有的灯架保留"
    ),
    "Bits per channel of the texture": "纹理每通道的位数",
    "Blender renders the photo of an object in this scene, under a rig of lights": (
        "Blender 在灯架照明下渲染此场景中物体的照片"
    ),
    "Brightness of a white matte surface that faces the light, where 1 is full white": (
        "正对灯光的白色哑光表面的亮度，1 为全白"
    ),
    "CPU threads for networks. 0: all there are": "网络使用的 CPU 线程数。0：全部",
    "Camera of this scene that took the photo: the one that Align Photo made, or one that you choose": (
        "此场景中拍摄照片的摄像机：由“对齐照片”生成，或由你选择"
    ),
    "Camera that takes the photo: the rig's own, or any other of this scene": (
        "拍摄照片的摄像机：灯架自带的，或此场景中的任何其他摄像机"
    ),
    "Camera whose focal length and shift the photo's camera gets, as of a calibrated lens or a cropped photo. Where it "
    "stands does not count. Empty: Lens (mm), and the photo's middle": (
        "照片的摄像机采用此摄像机的焦距和偏移，例如已标定的镜头或裁剪过的照片。其位置不起作用。"
        "留空：焦距 (mm) 与照片中心"
    ),
    "Chen et al. 2018 for three lights, half the published width": "Chen 等人 2018，用于三盏灯，宽度为发表的一半",
    (
        "Click 4 to 12 places in the photo and the same places on the mesh, for Align Photo. The photo opens beside "
        "the viewport. Drag a marker to move it, X deletes the one under the mouse, Backspace takes the last one "
        "back, Esc ends"
    ): (
        "在照片上和网格的相同位置点击 4 至 12 处，用于对齐照片。照片在视图旁打开。拖动标记可移动，X 删除鼠标下的标记"
        "，退格键撤回最后一处，Esc 结束"
    ),
    "Closed lumps: smooth, folded, ridged, wrinkled or faceted": "封闭的团块：光滑、折叠、带棱、起皱或带棱面",
    "Collection of the rig's objects": "灯架物体的集合",
    "Compare the estimated normals with the true ones: the angle between them in colour, its mean and its median": (
        "将估计的法线与真实法线比较：以颜色显示夹角，并给出平均值和中位数"
    ),
    "Compare the photos' normals with the map": "将照片的法线与贴图比较",
    "Convention, bit depth, format and automatic file name that a program expects; you can change each": (
        "按某个程序的要求设定约定、色深、格式和自动名称；每一项都可更改"
    ),
    "Copy that shows the coverage": "显示覆盖范围的副本",
    "Cycles samples a pixel for each of the three lights": "三盏灯每盏每像素的 Cycles 采样数",
    "Cycles samples a pixel for each of the three lights: more take longer and give less noise": (
        "三盏灯每盏每像素的 Cycles 采样数：越多耗时越长，噪点越少"
    ),
    "Cycles samples a pixel, shared by the three lights: more take longer and give less noise": (
        "每像素的 Cycles 采样数，由三盏灯分担：越多耗时越长，噪点越少"
    ),
    (
        "Direction in degrees of the red light as the camera sees it: 0 is right, 90 is up. Green and blue follow at "
        "120 and 240 degrees more"
    ): ("摄像机所见红灯的方向（度）：0 为右，90 为上。绿灯和蓝灯依次再加 120 度和 240 度"),
    (
        "Do this for all rigs of this scene, one after the other, each with its own settings. Off: for the chosen rig "
        "alone"
    ): ("依次对此场景的所有灯架执行，各用自己的设置。关闭：仅对所选灯架"),
    "Discs at a distance: brighter and from a steeper direction where the object is nearer": (
        "位于一定距离的圆盘：物体越近处越亮，入射越陡"
    ),
    "Empty that the lamp swings around": "灯所绕的空物体",
    "Empty that the lights turn to and that carries the rig: move it to move all of it": (
        "灯光朝向并承载灯架的空物体：移动它即移动全部"
    ),
    (
        "Estimate a photo for each camera, bring all into line with the mesh and bake them into one texture. Size, "
        "space, convention, margin, format, file, strength and what it goes on top of are those of the step Bake, "
        "the model is that of Estimate"
    ): (
        "为每台摄像机估计一张照片，使它们与网格一致，并烘焙到一张纹理中。尺寸、空间、约定、边距、格式、文件、强度以及"
        "叠加对象取自烘焙步骤，模型取自估计步骤"
    ),
    "Estimate the surface normals that the photo shows": "估计照片所示的表面法线",
    "File format of the heights. OpenEXR holds them in world units, the others from black to white": (
        "高度的文件格式。OpenEXR 以世界单位保存，其他格式从黑到白"
    ),
    "File format of the normal map": "法线贴图的文件格式",
    "File format of the texture; one that cannot hold the chosen depth takes its own": (
        "纹理的文件格式；不支持所选色深的格式使用自己的色深"
    ),
    "File of heights to write; what else is made goes beside it. Empty: a name of its own in the output folder": (
        "要写入的高度文件；其他生成的内容放在旁边。留空：输出文件夹中自动命名"
    ),
    "File of the true normals of the photo's view. Empty: none": "照片视角真实法线的文件。留空：无",
    "File to write; its ending decides the format. Empty: a name of its own in the output folder": (
        "要写入的文件；扩展名决定格式。留空：输出文件夹中自动命名"
    ),
    "Fill what no view sees, by continuing the relief around it smoothly within each UV island": (
        "填充没有视角看到的部分：在每个 UV 孤岛内平滑地延续周围的浮雕"
    ),
    "Find in the photo of a matt grey ball how the lights' colours mix, and add it to the rig file": (
        "在哑光灰球的照片中求出灯光颜色如何混合，并写入灯架文件"
    ),
    (
        "Find the camera that took a real photo from the mesh that it shows, and bake through that camera. Four "
        "pairs of points or more place it first, where there are any; the photo's outline and normals refine it"
    ): (
        "根据照片所示的网格，找到拍摄真实照片的摄像机，并通过该摄像机烘焙。若有四对以上的点，先用它们定位；再用照片的"
        "轮廓和法线细化"
    ),
    "Find the three lights in the photo of a mirror ball, and write a rig file that the estimate then uses": (
        "在镜面球的照片中找到三盏灯，并写出供估计使用的灯架文件"
    ),
    "Focal length in millimetres of the perspective camera, on a sensor 36 mm wide": (
        "透视摄像机的焦距（毫米），以 36 毫米宽的传感器计"
    ),
    ("35 mm equivalent focal length of the real camera, in millimetres. 0: the camera is assumed to be far away"): (
        "真实相机的 35 毫米等效焦距（毫米）。0：假定相机很远"
    ),
    (
        "35 mm equivalent focal length of the real camera, in millimetres. 0: the camera that the photo was "
        "rendered with, else the rig's"
    ): ("真实相机的 35 毫米等效焦距（毫米）。0：渲染照片的摄像机，否则为灯架的摄像机"),
    "Folder for each view's normals and albedo; the next run reuses them. Empty: they are not kept": (
        "保存每个视角的法线和反照率的文件夹；下次运行从这里继续。留空：不保留"
    ),
    "Folder for the demo's photo, normal map and texture. Empty: only the .blend file keeps them": (
        "演示的照片、法线贴图和纹理的文件夹。留空：仅保存在 .blend 文件中"
    ),
    "Folder for the textures. Empty: a folder of its own in the output folder": (
        "图片的文件夹。留空：输出文件夹中的专用文件夹"
    ),
    (
        "Folder of photos of the same poses under white light (the three lights turned white), named like the "
        "photos or NAME_white: also bakes the surface's colour, to TEXTURE_albedo, matched where views "
        "overlap; photos from three folders, one for each light, are added up. Empty: no albedo is baked"
    ): (
        "相同姿态在白光下（三盏灯都调为白色）的照片文件夹，名称与照片相同（也可为 NAME_white）：同时烘焙表面颜色，写"
        "入 TEXTURE_albedo，多个视角看到同一处时颜色相互匹配；若给出三个文件夹（每盏灯一个），则将照片相加。留空：不"
        "烘焙反照率"
    ),
    "Folder of these cameras' photos": "这些摄像机的照片所在文件夹",
    (
        "Folder for the samples; one begun with the same settings is continued. Empty: a folder of its own in "
        "the output folder"
    ): ("样本的文件夹；由相同设置开始的文件夹会继续。留空：输出文件夹中的专用文件夹"),
    "Folder of mesh files to take shapes from": "提供形状的网格文件所在文件夹",
    (
        "For a sequence of normals: take the target and the camera anew in each frame of the timeline, whose number "
        "is that of the normals. Off: as they stand now"
    ): ("用于法线序列：在时间线的每一帧重新读取目标和摄像机，帧号与法线的编号相同。关闭：按当前状态"),
    "Four per pixel: takes about four times as long": "每像素四个点：耗时约四倍",
    "Fraction of the photos' relief that is added to the object's own surface: 1 as it is, 0 none": (
        "照片浮雕加到物体自身表面上的比例：1 为原样，0 为无"
    ),
    "Fraction of the tile over which its borders blend: more hides the seam better but leaves a smaller tile": (
        "分块边缘相接部分占分块的比例：越大接缝越不明显，分块越小"
    ),
    "Frames of a sequence or video before and after each one to average it with, where they show the same surface": (
        "与序列或视频前后多少帧取平均（在它们显示相同内容之处）"
    ),
    "Free space around the object in the picture, as a fraction of the object's size": (
        "画面中物体周围的空白，以物体尺寸的比例计"
    ),
    "From above": "从上方",
    "From below": "从下方",
    "From where the photo's camera is looked for. Pairs of points go before it": "从何处开始寻找照片的摄像机。点对优先",
    "Graphics cards on Windows, where the installed onnxruntime has it": (
        "Windows 上的显卡，需所安装的 onnxruntime 支持"
    ),
    "Green is down: Unreal Engine": "绿色朝下：Unreal Engine",
    "Green is up: Blender, glTF, Unity, Godot": "绿色朝上：Blender、glTF、Unity、Godot",
    "Hanging and falling cloth": "悬挂和下垂的布料",
    "Height of the photo in pixels": "照片的高度（像素）",
    "Heights as the photo's camera sees them": "照片的摄像机所见的高度",
    "Heights on the object's UVs": "物体 UV 上的高度",
    (
        "Broadest bumps that heights on UVs keep, as a fraction of the object's size: broader shapes are left "
        "to the mesh, because estimated normals err most there. 0 keeps all"
    ): ("UV 上高度起伏的最大宽度，以物体尺寸的比例计：更宽的交给网格，因为估计的法线误差变化缓慢。0 保留全部"),
    "How far the aligned mesh's point is from the place in the photo, in pixels. -1: not aligned yet": (
        "对齐后网格上的点距照片中的位置多少像素。-1：尚未对齐"
    ),
    "How far the cameras look down on the object, in degrees. 0: from the side, 90: from above": (
        "摄像机俯视物体的角度（度）。0：从侧面，90：从上方"
    ),
    "How far the lights and an orthographic camera stand from the object, in radii of the object": (
        "灯光和正交摄像机离物体多远，以物体半径为单位"
    ),
    (
        "Distance from the camera to the object, in the unit of a rig file with near lights. 0: as far as the "
        "rig's target, or by the surface"
    ): ("物体离摄像机多远，单位与近距灯光的灯架文件相同。0：与灯架目标的距离，或按表面"),
    (
        "Mean distance from the camera to the visible surface, in the unit of the heights: it sets a perspective "
        "camera's scale, and where an orthographic camera's mesh stands. 0: as far as the target is in this scene"
    ): (
        "物体到摄像机的平均距离，单位与高度相同：透视摄像机由此确定比例，正交摄像机则由此确定网格的位置。0：与此场景"
        "中目标的距离"
    ),
    "How far the outlines of mesh and photo are apart, in pixels. -1: not known": (
        "网格与照片的轮廓相距多少像素。-1：未知"
    ),
    "How large each light looks from the object, in degrees. Larger lights give softer shadows": (
        "从物体看每盏灯有多大（度）。灯越大阴影越柔和"
    ),
    "How long it will still take, in words. Empty: not known yet": "还需多长时间（文字）。留空：尚未知",
    "How many faces the mesh may have at most; they are smaller where the surface bends": (
        "网格最多可以有多少个面；表面弯曲处的面较小"
    ),
    (
        "How many half waves across the photo to remove as bends of the material and uneven light. 0: only "
        "the tilt of the photo"
    ): ("跨照片多少个半波作为材质的弯曲和不均匀的光被去除。0：仅去除照片的倾斜"),
    "How many processes run at the same time on this machine. 0: one for each CPU core": (
        "本机同时运行多少个进程。0：每个处理器核心一个"
    ),
    "How many rigs stand around the object": "物体周围有多少个灯架",
    "How many samples in a row show the same shape, each in another pose, light and material": (
        "连续多少个样本显示同一形状，各有不同的姿态、灯光和材质"
    ),
    "How many samples the folder will hold in total. A larger count continues where a smaller one stopped": (
        "文件夹最终应有多少个样本。更大的数量会从较小数量停止处继续"
    ),
    "How many tiles wide and high the plane is that shows the material": "显示材质的平面有多少个分块宽和高",
    "How much is done, as a fraction": "已完成的比例",
    "How many times light bounces between surfaces at most, drawn for each sample. 0: none": (
        "光线在表面之间最多反弹多少次，每个样本重新抽取。0：不反弹"
    ),
    (
        "How often the mesh is subdivided first: each makes four times as many faces, which take more of the relief's "
        "shape. But a low poly's facets show more in its shadows, as Cycles softens those of large faces. 0: its own "
        "vertices move, and the normal map shows the rest"
    ): (
        "先将网格细分多少次：每次面数变为四倍，从而更多地呈现浮雕的形状。但低模的棱面在其阴影中会更明显，因为 Cycles "
        "会柔化大面的阴影。0：只移动网格自身的顶点，其余由法线贴图显示"
    ),
    "How the camera that comes with the rig projects": "灯架自带摄像机的投影方式",
    "How the last run of each of its operators ended": "其每个操作项上次运行的结果",
    "How the last run of each operator ended": "每个操作项上次运行的结果",
    "How the material shows its relief in Blender": "材质在 Blender 中如何显示其浮雕",
    "How the mesh is subdivided": "网格如何细分",
    "How the photo's values encode light": "照片的数值如何表示光",
    "How the photogrammetry program's mesh came into Blender, so that mesh and cameras meet": (
        "摄影测量程序的网格是如何导入 Blender 的，以便网格与摄像机对应"
    ),
    "How the viewport was shaded before, as JSON": "视图之前的着色方式，JSON 格式",
    "How well the mesh fits the photo, in words. Empty: not aligned": "网格与照片的吻合程度（文字）。留空：未对齐",
    "The surface breaks where one object occludes another; takes several times as long": (
        "在一物位于另一物之前处断开；耗时数倍"
    ),
    "Ju et al. 2018: three intensities from each pixel, then equation 2": (
        "Ju 等人 2018：由每个像素得出三个强度，再用公式 2"
    ),
    "Keep the bake's settings as a preset, or remove one; files and names are not kept": (
        "将烘焙设置保存为预设，或移除一个预设；文件和名称不会保存"
    ),
    "Keep the rig's settings as a preset, or remove one": "将灯架设置保存为预设，或移除一个预设",
    "Kinds of generated shapes, of which each sample shows one": "生成形状的种类，每个样本显示其中一种",
    "Let a white lamp swing around what the viewport shows, in place of the rigs' lights. Press again to end it": (
        "让一盏白灯绕着视图中的内容摆动，代替灯架的灯光。再按一次结束"
    ),
    (
        "Let the Python of this file, drivers and text blocks, run in the next render. Only for files whose maker "
        "you trust"
    ): ("让此文件中的 Python（驱动器和文本块）在下次渲染时运行。仅用于你信任其作者的文件"),
    "Light falls as on the relief; the surface itself stays flat": "光照如同落在浮雕上；表面本身保持平坦",
    "Linear for float files and camera raw, sRGB for all others, unless the file says otherwise": (
        "浮点文件和相机 RAW 为线性，其他为 sRGB，除非文件另有说明"
    ),
    "Make a mesh of the surface, where the photo's camera saw it, with the photo's UVs": (
        "在照片的摄像机所见之处生成表面网格，使用照片的 UV"
    ),
    (
        "Make a node group of the baked texture, and of its heights where there are, to drag into other materials. "
        "The Asset Browser shows it. Press again after another bake or displacement"
    ): ("由烘焙的纹理（以及高度，若有）生成节点组，可拖入其他材质。资产浏览器会显示它。再次烘焙或置换后请再按一次"),
    (
        "Make a seamless material of the photo, which shows cloth, leather or bark that lies flat and fills it. "
        "Writes normals, height, curvature and albedo, and shows the material on a plane of its true size"
    ): (
        "由照片制作无缝材质，照片应显示平放且充满画面的布、皮革或树皮。写出法线、高度、曲率和反照率，并在真实尺寸的平"
        "面上显示该材质"
    ),
    "Make heights of the estimated normals: a file, a mesh where the camera saw the object, pictures of its shape": (
        "由估计的法线生成高度：一个文件、摄像机所见处的网格、显示其形状的图片"
    ),
    (
        "Make one photo of three, each of them under one of the rig's lights alone, turned white. The object may not "
        "move between them. Each photo becomes a channel, so that paint does not mislead the estimate"
    ): (
        "由三张照片合成一张，每张仅由灯架的一盏灯照明并调为白色。期间物体不得移动。每张照片成为一个通道，使颜料不会误"
        "导估计"
    ),
    "Make the baked texture's heights on the target's UVs and displace its surface by them": (
        "在目标的 UV 上生成烘焙纹理的高度，并据此置换其表面"
    ),
    "Mark nothing; what is marked already stays so": "不标记；已标记的保持不变",
    (
        "Measured rig (.json or .lp) of photos that you open. A photo that was rendered in this scene is estimated "
        "with the rig that it was rendered with. Empty: the rig beside the photo when it was opened, else the rig in "
        "this scene"
    ): (
        "所打开照片的实测灯架（.json 或 .lp）。在此场景中渲染的照片使用渲染时的灯架。留空：打开时照片旁的灯架，否则为"
        "此场景的灯架"
    ),
    (
        "Mesh object that gets the texture. Empty: the active object. Photos that are rendered leave the target out "
        "where the detailed object is in its place"
    ): ("获得纹理的网格物体。留空：活动物体。渲染照片时，若细节物体位于同一位置，则不包含目标"),
    (
        "Mesh that gives each pixel's distance to near lights (area and point lights). Empty: all is assumed to be "
        "as far as the rig's target"
    ): ("给出每个像素到近距灯光（面光和点光）距离的网格。留空：假定全部与灯架目标同样远"),
    "Mesh that was made of the normals and their heights": "由法线及其高度生成的网格",
    "Middle of the ball at its second place, in pixels from the photo's left edge": (
        "第二位置的球心距照片左边缘的像素数"
    ),
    "Middle of the ball at its second place, in pixels from the photo's top edge": "第二位置的球心距照片上边缘的像素数",
    "Middle of the ball, in pixels from the photo's left edge. Only counts with a radius below": (
        "球心距照片左边缘的像素数。仅在下方给出半径时有效"
    ),
    "Middle of the ball, in pixels from the photo's top edge": "球心距照片上边缘的像素数",
    "NVIDIA graphics cards, where the installed onnxruntime has it": "NVIDIA 显卡，需所安装的 onnxruntime 支持",
    "Name of the mesh object that gets the texture. Empty: the panel's target, else the active object": (
        "获得纹理的网格物体名称。留空：面板中的目标，否则为活动物体"
    ),
    "Name of the mesh object that gives each pixel's distance to near lights. Empty: the panel's": (
        "给出每个像素到近距灯光距离的网格物体名称。留空：面板中的物体"
    ),
    "Name of a camera object whose focal length and shift the photo's camera gets. Empty: the one in the panel, unless "
    "Lens (mm) is given": ("摄像机物体的名称，照片的摄像机采用其焦距和偏移。留空：面板中选定的，除非给出了焦距 (mm)"),
    "Name of the mesh object that the photo shows. Empty: the target of the bake, else the active one": (
        "照片所示网格物体的名称。留空：烘焙的目标，否则为活动物体"
    ),
    "Network in an .onnx file": ".onnx 文件中的网络",
    "No perspective: every pixel looks in the same direction": "无透视：每个像素都朝同一方向看",
    (
        "Normal map (tangent space, same UVs) to add the detail to; <OBJECT>, <MATERIAL> and <UDIM> in its "
        "name stand for those of each texture; or a .json file that lists several maps. Empty: those in the "
        "materials"
    ): (
        "要在其上叠加的法线贴图（切向空间，相同的 UV）；名称中的 <OBJECT>、<MATERIAL> 和 <UDIM> 代表各纹理所属；或列"
        "出多张贴图的 .json 文件。留空：材质中的贴图"
    ),
    "Normal map in camera space": "摄像机空间的法线贴图",
    (
        "Normal map to write: .png, .tif or .exr; a folder for several photos, where frames that are already "
        "there are skipped. Empty: a name of its own in the output folder"
    ): ("要写入的法线贴图：.png、.tif 或 .exr；有多张照片时为文件夹：其中已有的帧不会重做。留空：输出文件夹中自动命名"),
    "Leave flat normals": "不填充：平坦的法线",
    "Number in the list, from 0, of the rig that the panel shows. Change it with mps.choose_rig": (
        "面板所显示灯架在列表中的编号，从 0 起。用 mps.choose_rig 更改"
    ),
    "Number of the first frame of normals, where they are a sequence": "法线为序列时第一帧的编号",
    "Number of the last frame of normals, where they are a sequence": "法线为序列时最后一帧的编号",
    "Number of the pair in the photo's list, from 0": "点对在照片列表中的编号，从 0 起",
    "Number of the rig in the scene's list, from 0": "灯架在场景列表中的编号，从 0 起",
    "One for each material; its name goes into the file's name": "每个材质一张；材质名写入文件名",
    "One for each object; its name goes into the file's name": "每个物体一张；物体名写入文件名",
    "One, at the pixel's centre": "像素中心的一个点",
    "One of the rig's three lights": "灯架三盏灯之一",
    "One surface without gaps: for one object, reliefs, cloth": "没有间隙的单一表面：用于单个物体、浮雕、布料",
    (
        "Open a captured photo (PNG, TIFF, JPEG, OpenEXR, camera raw), all frames of a sequence, or a video. Files "
        "NAME.rig.json and NAME.camera.json beside it are read"
    ): (
        "打开拍摄的照片（PNG、TIFF、JPEG、OpenEXR、相机 RAW）、序列的全部帧或视频。会读取旁边的 NAME.rig.json 和 "
        "NAME.camera.json 文件"
    ),
    (
        "Open the photo's mask in an Image Editor to paint on it: white adds to the object, black takes away. The "
        "next estimate uses it as it is painted then. Press again to see what it comes to"
    ): ("在图像编辑器中打开照片的遮罩进行绘制：白色加入物体，黑色去除。下一次估计按当时所绘使用。再按一次查看结果"),
    "OpenEXR file to write, or an animation's folder. Empty: a name of its own in the output folder": (
        "要写入的 OpenEXR 文件，或动画的文件夹。留空：输出文件夹中自动命名"
    ),
    "OpenEXR file to write. Empty: a name of its own in the output folder": (
        "要写入的 OpenEXR 文件。留空：输出文件夹中自动命名"
    ),
    "Operator whose work runs. Empty: none": "正在运行的操作项。留空：无",
    "PNG and TIFF": "PNG 和 TIFF",
    "Parallel light: as bright and from the same direction everywhere on the object": (
        "平行光：在物体各处亮度相同、方向相同"
    ),
    "Photo of a matt grey ball under the red, green and blue light at once": "哑光灰球的照片，红、绿、蓝三灯同时点亮",
    "Photo of a mirror ball where the object stands, under the red, green and blue light at once": (
        "放在物体位置的镜面球照片，红、绿、蓝三灯同时点亮"
    ),
    (
        "Photo of an even white card in the object's place, to correct vignetting and uneven light; several "
        "(a folder or pattern) are averaged; not for near lights"
    ): ("在物体位置的均匀白卡照片，用于校正镜头和灯光的不均；文件夹或文件名模式中的多张取平均；不能与近距灯光一起使用"),
    "Photo of the object at rest under the rig's first light alone, turned white: the red channel": (
        "静止物体仅在灯架第一盏灯下的照片，灯调为白色：红色通道"
    ),
    (
        "Photo of the same ball at another place. With two places the lights' positions are found, not only their "
        "directions. Needs the lens"
    ): ("同一个球在另一位置的照片。有两个位置就能求出灯光的位置，而不仅是方向。需要焦距"),
    "Photo of the same pose under the rig's second light alone, turned white: the green channel": (
        "相同姿态仅在灯架第二盏灯下的照片，灯调为白色：绿色通道"
    ),
    "Photo of the same pose under the rig's third light alone, turned white: the blue channel": (
        "相同姿态仅在灯架第三盏灯下的照片，灯调为白色：蓝色通道"
    ),
    "Photo of the scene without the object, under the same lights": "相同灯光下不含物体的场景照片",
    "Photo under red, green and blue light": "红、绿、蓝光下的照片",
    "Photo with the three lights off, to subtract; several (a folder or pattern) are averaged": (
        "三盏灯关闭时的照片，将被减去；文件夹或文件名模式中的多张取平均"
    ),
    "Curvature map: edges are bright, creases dark": "棱边为亮、凹痕为暗的图片",
    "Ambient occlusion map: white where the surface is fully open to light": (
        "表示表面开阔程度的图片，即环境光遮蔽：光线全部可达处为白"
    ),
    "Image of the surface under a white light, with the ambient occlusion if that is made": (
        "白光下表面的图片，若生成了环境光遮蔽则以其着色"
    ),
    "Picture that is white where the object is and black elsewhere": "物体处为白、其他处为黑的图片",
    "Pixels brighter than this fraction of the photo's brightest are the object": (
        "亮度超过照片最亮处这一比例的像素属于物体"
    ),
    "Pixels by which the texture extends beyond the UV islands": ("纹理向 UV 孤岛边界之外延伸的像素数"),
    "Pixels to leave out at the photo's bottom": "照片底部要去掉的像素数",
    "Pixels to leave out at the photo's left edge": "照片左边缘要去掉的像素数",
    "Pixels to leave out at the photo's right edge": "照片右边缘要去掉的像素数",
    "Pixels to leave out at the photo's top": "照片顶部要去掉的像素数",
    "Place in the photo in pixels from its top left corner": "照片中的位置，从左上角起的像素数",
    "Places in the photo and on the mesh that are the same": "照片中和网格上的相同位置",
    "Points on the surface that each pixel averages; more take longer but smooth jagged edges": (
        "每个像素取表面多少个点的平均；点越多耗时越长，锯齿越少"
    ),
    "Radius of the ball's outline at its second place, in pixels. Needed where the first one is given": (
        "第二位置的球轮廓半径（像素）。给出第一个时必须给出"
    ),
    "Radius of the ball's outline in pixels. 0: the ball is looked for": "球轮廓的半径（像素）。0：自动查找球",
    (
        "Radius of the ball, in the unit for the lights' positions, best that of the mesh. Needed where "
        "lights have positions, for a grey ball too"
    ): ("球的半径，单位与所求位置相同：最好是网格的单位。灯光有位置时才起作用，对灰球也一样"),
    "Remove the chosen rig with its lights and its camera; its photo and normals stay as files and images": (
        "移除所选灯架及其灯光和摄像机；其照片和法线作为文件和图像保留"
    ),
    "Remove the rig's lights, camera and target": "移除灯架的灯光、摄像机和目标",
    "Remove this pair of points": "移除这对点",
    (
        "Render the object with Cycles, lit by the rig's red, green and blue light alone, beside the live window. "
        "Other lights and the world are off. The scene is rendered as it is now and stays as it is. The rig and the "
        "camera, as they stand, are written beside the photo"
    ): (
        "用 Cycles 渲染物体，仅由灯架的红、绿、蓝灯照明，渲染时窗口仍可操作。其他灯光和世界环境关闭。场景按当前状态渲"
        "染且不被改变。灯架和摄像机的当前状态写在照片旁"
    ),
    (
        "Render the true normals of the photo's view, as an OpenEXR with Blender's Normal pass, to compare with. The "
        "camera is written beside the file"
    ): ("渲染照片视角的真实法线，写为带 Blender 法线通道的 OpenEXR，用于比较。摄像机写在文件旁"),
    (
        "Render training data into a folder, with several Blenders beside this one. What the folder holds already is "
        "not rendered again: after a stop, run it again and it goes on"
    ): ("用多个与此并行的 Blender 将训练数据渲染到文件夹中。文件夹中已有的不会重新渲染：停止后再次运行即可继续"),
    "Rig file to write (.json). Empty: a name of its own in the output folder": (
        "要写入的灯架文件 (.json)。留空：输出文件夹中自动命名"
    ),
    "Say whether the photo is exposed and focused well, and what its lights reach, before it is used": (
        "在使用之前说明照片的曝光和对焦是否良好，以及灯光照到了哪里"
    ),
    (
        "Second photo of the same pose under white light (the three lights turned white), which shows the "
        "colour of the surface. Photos of one light each (a folder or pattern) are added up. For one still "
        "photo only"
    ): (
        "相同姿态在白光下的第二张照片：三盏灯都调为白色。它显示表面的颜色。文件夹或文件名模式中每盏灯一张的照片会相加"
        "。仅用于单张静态照片"
    ),
    (
        "See all steps in a new scene: an object, its photo under three coloured lights, the normals estimated from "
        "it, and a low-poly copy that uses them. Takes seconds to half a minute and changes nothing of yours"
    ): (
        "在新场景中查看所有步骤：一个物体、三盏彩灯下的照片、由此估计的法线，以及使用该法线的低面数副本。耗时数秒至半"
        "分钟，不改变你的任何内容"
    ),
    (
        "See the scene in this viewport as the camera sees it that took the photo, in the photo's frame. The scene's "
        "resolution is the photo's meanwhile. Press again, or turn the view, to leave it"
    ): (
        "在此视图中以拍摄照片的摄像机的视角和照片的画幅查看场景。期间场景的分辨率为照片的分辨率。再按一次或旋转视图即"
        "可退出"
    ),
    "Several objects beside each other on a ground": "地面上并排的多个物体",
    (
        "Shade the displaced surface by the baked normals, subdivided as a texture in object space: the relief shows "
        "once, with what is finer than the mesh. Off, for objects that bend: by the displaced surface alone"
    ): (
        "用烘焙的法线（细分时为物体空间纹理）为置换后的表面着色：浮雕只出现一次，并包含比网格更细的部分。对会弯曲的物体请关闭"
        "：仅用置换后的表面"
    ),
    "Shapes made up from the seed: nothing else is needed": "由随机种生成的形状：不需要其他东西",
    (
        "Show on the objects what the views saw: green there, orange where it is filled, red elsewhere. The objects "
        "and their materials stay as they are: copies that no render shows stand over them. Press again to end it"
    ): (
        "在物体上显示各视角看到了什么：看到处为绿色，填充处为橙色，其他为红色。物体及其材质保持不变：上面是渲染不显示"
        "的副本。再按一次结束"
    ),
    'Show the tab "MPS Training" in the sidebar of the 3D viewport, which renders training data': (
        "在 3D 视图的侧栏中显示“MPS Training”标签页，用于渲染训练数据"
    ),
    "Show what the three lights reach while you move them, the camera or the object. Press again to leave it": (
        "在移动灯光、摄像机或物体时显示三盏灯照到哪里。再按一次退出"
    ),
    "Show which pixels of the photo count as the object, before they are used. The mask is written as a file, too": (
        "在使用之前显示照片的哪些像素算作物体。遮罩也会写为文件"
    ),
    "Sixteen per pixel: takes about sixteen times as long": "每像素十六个点：耗时约十六倍",
    "Size, depth and seam of the material that was made": "所制材质的尺寸、深度和接缝",
    "Slabs with a relief": "带浮雕的板",
    "Some of the samples": "部分样本",
    "Stop what is running; nothing half-written is left": "停止正在运行的工作；不会留下写了一半的文件",
    "TIFF and OpenEXR": "TIFF 和 OpenEXR",
    "Table of what was found: lines of cells with | between them": "查找结果的表格：各行单元格以 | 分隔",
    (
        "Take a photo of each frame of the scene, from its first to its last, into a folder. Lights and camera "
        "should move together if they move: those of the first frame count for all"
    ): ("为场景从首帧到末帧的每一帧拍一张照片，存入文件夹。灯光和摄像机若移动应一起移动：以第一帧为准"),
    (
        "Take large shapes from the object and only detail from the photos, whatever else the estimates say: "
        "seams between views vanish"
    ): ("大形状取自物体，只有细节取自照片，无论估计结果如何：视角之间的接缝消失"),
    "Take the noise from each light's picture with OpenImageDenoise, where light goes between surfaces": (
        "在光线在表面之间反弹之处，用 OpenImageDenoise 去除每盏灯画面的噪点"
    ),
    "Dismiss this message; you can run the step again": "关闭此消息；该步骤可以再次运行",
    (
        "Texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for each "
        "tile, material or object; a folder for a sequence, or to take the name from a preset. Empty: in the "
        "output folder"
    ): (
        "要写入的纹理：.png、.tif 或 .exr；名称中含 <UDIM>、<MATERIAL> 或 <OBJECT> 时，每个分块、材质或物体一张；序列"
        "或使用预设名称时为文件夹。留空：写入输出文件夹"
    ),
    "The 3D viewport shows the mesh about as the photo does": "3D 视图中网格的样子与照片大致相同",
    "The angles between the normals and the true ones": "估计的法线与真实法线之间的夹角",
    "The baked normal texture": "烘焙的法线纹理",
    "The baseline for flat, matt cloth, leather or plaster of one colour: each channel divided by its mean": (
        "用于单一颜色的平整哑光布料、皮革或石膏的基线：每个通道除以其平均值"
    ),
    "The baseline, at once: a matt surface of one grey (equation 2 of the paper)": (
        "基线，即时完成：单一灰度的哑光表面（论文公式 2）"
    ),
    "Only the camera moved; a rig file gives directions along the mesh's axes, or positions in its world": (
        "摄像机绕行；灯架文件中的方向沿网格的坐标轴，或位置在其世界中"
    ),
    "The cluster's address need not be tls://. Whoever is in its network may run code on this machine": (
        "集群的地址不必是 tls://。其网络中的任何人都可能在本机运行代码"
    ),
    "The copies that show the coverage, while it is shown": "显示覆盖范围期间的副本",
    "The default in one pass: a sixth to half of the time, a little less accurate": (
        "默认网络只算一次：耗时为六分之一到一半，精度略低"
    ),
    "The default: one network from coarse to fine, with equation 2 inside, that tells how sure it is": (
        "默认：一个由粗到细的网络，内含公式 2，并给出其把握程度"
    ),
    "Extend the islands by the margin": "将孤岛向外延伸边距的宽度",
    "The lamp, while it is there": "存在期间的灯",
    "35 mm equivalent focal length of the lens, in millimetres. 0: that of the photo; estimated too where that is 0": (
        "镜头的 35 毫米等效焦距（毫米）。0：照片的焦距；若其也为 0，则一并求出"
    ),
    "The lights are fixed to the camera, or the object stood on a turntable": "灯光固定在摄像机上，或物体放在转台上",
    "The map was made from the same object": "贴图由同一物体制成",
    "The map was sculpted or painted": "贴图是雕刻或绘制的",
    "The mask, drawn over the photo": "绘制在照片上的遮罩",
    "The material, repeated": "重复排列的材质",
    "The materials that use the texture": "使用该纹理的材质",
    "The mesh becomes round, edges with a crease apart: for one that is made for it": (
        "网格变得圆滑，带折痕的边除外：用于为此制作的网格"
    ),
    "The mesh keeps its shape, its smooth shading and its sharp edges": "网格保持其形状、平滑着色和锐边",
    "The mesh objects that are selected in this scene": "此场景中选中的网格物体",
    "The meshes in a folder, alone and several together: OBJ, PLY, STL, OFF or glTF files": (
        "文件夹中的网格，单个或多个一起：OBJ、PLY、STL、OFF 或 glTF 文件"
    ),
    "The normals of that photo": "该照片的法线",
    "The objects that use the texture": "使用该纹理的物体",
    "The paper's network, patch by patch: only for rigs like the paper's": (
        "论文的网络，逐块计算：仅适用于与论文相似的灯光装置"
    ),
    "The photo is a numbered frame, and all frames that are numbered like it are meant": (
        "照片是带编号的一帧，指所有同样编号的帧"
    ),
    "The photo that these normals were estimated from": "估计这些法线所用的照片",
    "The photo that was taken with it": "用它拍摄的照片",
    "The photo under red, green and blue light": "红、绿、蓝光下的照片",
    "The photo with the outlines of mask and mesh": "带有遮罩和网格轮廓的照片",
    (
        "The photo's alpha if it has one, as rendered photos do; else the object if it stands out clearly; else the "
        "whole photo"
    ): "若照片有 Alpha（渲染的照片有），则使用它；否则使用明显突出于背景的物体；否则使用整张照片",
    "The photo's camera, else the scene's, stands about where the photo was taken": (
        "照片的摄像机（否则为场景的摄像机）大致位于拍摄位置"
    ),
    "The photo, bright where it is the object and dark elsewhere, to be painted on": "供绘制的照片，物体处亮，其他处暗",
    "The plane that shows the material": "显示材质的平面",
    "The rig's red, green and blue light, in this order": "灯架的红、绿、蓝灯，按此顺序",
    "The rig's settings and objects": "灯架的设置和物体",
    "The rigs' lights that it hid": "被它隐藏的灯架灯光",
    "The same place on the mesh, in units of the world": "网格上的相同位置，以世界单位计",
    "The scene's rigs, where it has several": "场景的灯架（若有多个）",
    "The side of the object that the camera sees": "摄像机所见的物体一侧",
    "The surface itself is displaced by the true height in Cycles, and what is finer than its faces is a bump": (
        "在 Cycles 中按真实高度置换表面本身，比其面更细的部分为凹凸"
    ),
    "The surface's colour": "表面的颜色",
    "The target alone": "仅目标",
    "The whole photo: a wall or cloth that fills it": "整张照片：充满画面的墙或布",
    "Fill the whole texture smoothly": "平滑地填满整张纹理",
    "This address need not be tls://. Whoever is in its network may run code on this machine": (
        "此地址不必是 tls://。其网络中的任何人都可能在本机运行代码"
    ),
    "To the object: for objects that do not bend": "相对于物体：用于不弯曲的物体",
    "To the surface, by MikkTSpace: the object may move, bend and be reused": (
        "相对于表面，按 MikkTSpace：物体可以移动、弯曲和重复使用"
    ),
    "Turned from Y up to Z up, as Blender's importers of OBJ and glTF do by default": (
        "从 Y 向上转为 Z 向上，与 Blender 的 OBJ 和 glTF 导入器默认相同"
    ),
    "Twice the value is twice the light": "数值加倍即光量加倍",
    "UV map of the target to bake onto. Empty: the one that is active for rendering": (
        "烘焙所用的目标 UV 贴图。留空：渲染所用的活动 UV 贴图"
    ),
    "Viewport that shows the coverage, and how it was shaded before, as JSON": (
        "显示覆盖范围的视图及其之前的着色方式，JSON 格式"
    ),
    "Views all around the mesh are tried; the best one counts": "尝试网格周围的各个视角，取最好的一个",
    "What Blender's Asset Browser shows of the result": "Blender 的资产浏览器显示结果中的什么",
    (
        "Cameras from photogrammetry: a COLMAP folder, Metashape's .xml, Meshroom's .sfm or a folder of "
        "NAME.camera.json. Empty: this scene's cameras, each with its photo as background image"
    ): (
        "摄影测量程序写出的内容：COLMAP 文件夹、Metashape 的 .xml 或 Meshroom 的 .sfm；或含 NAME.camera.json 的文件夹"
        "。留空：此场景的摄像机，各以其照片为背景图"
    ),
    "What has a texture of its own": "什么拥有自己的纹理",
    "What is being done": "正在做什么",
    "What is bright in the picture that Paint Mask opens, as it is painted now": (
        "“绘制遮罩”所打开图片中明亮的部分，以当时所绘为准"
    ),
    "What is smaller than about twice this fraction of the object's size is detail, and taken from the photos": (
        "小于物体尺寸这一比例约两倍的是细节，取自照片"
    ),
    "What kind of lights the rig has": "灯架使用哪种灯光",
    "How to fill the texture beyond the UV islands, which mipmaps blend into the islands' borders": (
        "UV 孤岛边界之外的内容，缩小后的纹理会用到"
    ),
    "What moves the surface": "用什么移动表面",
    "What networks run on. The Lambertian baseline always runs on the CPU": (
        "网络在什么设备上运行。朗伯基线始终在 CPU 上运行"
    ),
    "What stands out from a dark or plain background, which takes up most of the photo's border": (
        "从占据照片大部分边缘的暗色或单色背景中突显的部分"
    ),
    "What the last run had to say, a line each": "上次运行的说明，每行一条",
    "Whether the lights moved with the camera or stood still in the world": "拍摄照片时灯光随什么移动",
    (
        "What the photo's whole width measures on the material, in this scene's unit. 0: by the orthographic camera "
        "that the photo was rendered with"
    ): ("照片的整个宽度在材质上有多宽，以此场景的单位计。0：按渲染照片的正交摄像机"),
    "Seed of the random draws: the same seed gives the same samples": ("抽取样本的依据：相同的随机种得到相同的样本"),
    "What the samples show": "样本显示什么",
    "What the texture's normals are relative to": "纹理中的法线相对于什么",
    "Model that estimates the normals, by name or as an .onnx file": (
        "用什么把照片变成法线：按名称选择模型，或 .onnx 文件"
    ),
    "What was found, drawn over the photo": "查找结果，绘制在照片上",
    "What you change in the steps' settings is what the next new file begins with, files and names apart": (
        "你在各步骤设置中所作的更改成为下一个新文件的初始值，文件和名称除外"
    ),
    "Where a mask picture is white": "遮罩图片为白色之处",
    (
        "Where photos, normal maps and textures go. Empty: beside the saved .blend file, else Blender's temporary "
        "folder"
    ): ("照片、法线贴图和纹理的存放位置。留空：保存的 .blend 文件旁，否则为 Blender 的临时文件夹"),
    "Where it hid them": "在哪个视图层中隐藏了它们",
    "Where the photo comes from, and so which settings the panel shows": "照片的来源，决定面板显示哪些设置",
    "Where the photo differs from one of the scene without the object": "照片与不含物体的场景照片不同之处",
    "Where the photo is brighter than a threshold": "照片比阈值更亮之处",
    "Where the photo is opaque": "照片不透明之处",
    "Whether the mesh fits the photo too poorly to bake with": "网格与照片是否吻合太差而不能烘焙",
    "Whether the photos already show the existing map's relief, which is then not added twice": (
        "照片是否也显示了现有贴图的浮雕；若是，则不再重复叠加"
    ),
    "Whether the surface may break": "表面是否可以断开",
    "Whether to stop the work": "是否应停止工作",
    "Which objects are baked onto, in one go: they hide one another from the cameras": (
        "一次烘焙到哪些物体上：它们会在摄像机前相互遮挡"
    ),
    "Which of this texture's texels some view saw": "此纹理的哪些纹素被某个视角看到",
    "Which pixels of the photo are the object": "照片中的哪些像素是物体",
    "Which way the green channel of the existing map points": "现有贴图绿色通道的指向",
    "Which way the texture's green channel points": "纹理绿色通道的指向",
    'Whose message to take away: "estimate" for mps.estimate': '要关闭谁的消息："estimate" 表示 mps.estimate',
    "Why the last run failed and how to mend it. Empty: it did not": "上次运行失败的原因及补救方法。留空：没有失败",
    "Width and height of a sample in pixels": "样本的宽度和高度（像素）",
    "Width and height of the demo's photo in pixels": "演示照片的宽度和高度（像素）",
    "Width and height of the demo's texture in pixels": "演示纹理的宽度和高度（像素）",
    "Width and height of the textures in pixels. 0: the photo's own resolution": (
        "图片的宽度和高度（像素）。0：照片在该处的像素数"
    ),
    (
        "What lit the white photo: the rig's three lights turned white, or one lamp in this direction in degrees. "
        "Empty: the rig's three lights"
    ): ("白光照片由什么照亮：装置的三盏灯调成白色，或位于该方向（度）的一盏灯。留空：装置的三盏灯"),
    "Width and height of the texture in pixels": "纹理的宽度和高度（像素）",
    "Width of the photo in pixels": "照片的宽度（像素）",
    "With forward Y and up Z, as Blender's importer of PLY does": "Y 向前、Z 向上，与 Blender 的 PLY 导入器相同",
    "Work with this rig, its photo and its estimate": "使用此灯架及其照片和估计",
    "Works everywhere": "到处可用",
    "Write an HTML page that shows which views cover what and how much they disagree": (
        "写一个 HTML 页面，显示各视角覆盖了什么以及相互差异有多大"
    ),
    "Written as NAME_Normal.png, 8 bits per channel": "写为 NAME_Normal.png，每通道 8 位",
    "Written as NAME_normal.png, 16 bits per channel": "写为 NAME_normal.png，每通道 16 位",
    "Written as NAME_normal.png, 8 bits per channel": "写为 NAME_normal.png，每通道 8 位",
    "Written as T_NAME_N.png, 16 bits per channel": "写为 T_NAME_N.png，每通道 16 位",
    "Written as name_normal.png, 8 bits per channel": "写为 name_normal.png，每通道 8 位",
    "You took the photo of a real object under real lights": "你在真实灯光下拍摄了真实物体的照片",
}
